"""Thousands of malformed files and programs: each is read, or refused with words, within a second.

    python test/stress/fuzz_files.py --files 5000

Kinds: scene files, feature files (.npz), meshes (.obj, .stl, .ply), calibrations (YAML), array programs, terrains
(.npy, .png, .asc), arrays, pictures (.png, .jpg, .tiff, .bmp), saved cases. Files are good ones with bytes, lines and
numbers changed, cut or repeated; now and then one whose header promises gigabytes.
"""

from __future__ import annotations

import argparse
import importlib
import io
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import cv2
import numpy as np

import csg_renderer
from csg_renderer.scene.height_files import read_heights
from dap_emulator.dap_cli import value_of
from dap_emulator.fortran_plus import compile as compile_program
from dap_emulator.fortran_plus.library import program_names, program_source
from model_matcher.closed_form.saved import load_case
from msgs_py import FeatureSet
from stereo_recovery.cameras.calibration import load_cameras
from stereo_recovery.pair_files import read_image as read_picture

HANG_S = 1.0
ODD_NUMBERS = ('0', '-1', '1e308', '-1e-320', '9' * 400, 'nan', 'inf', '1e', '0x10', '1..2', '99999999999')


def cut_or_repeat(rng: np.random.Generator, text: str) -> str:
    """Lines lost, exchanged, repeated; the end missing."""
    lines = text.splitlines(keepends=True)
    for _ in range(int(rng.integers(1, 4))):
        if not lines:
            break
        a, b = (int(v) for v in rng.integers(0, len(lines), 2))
        how = int(rng.integers(4))
        if how == 0:
            del lines[a]
        elif how == 1:
            lines[a], lines[b] = lines[b], lines[a]
        elif how == 2:
            lines.insert(a, lines[b] * int(rng.integers(1, 20)))
        else:
            lines[a] = lines[a][: len(lines[a]) // 2]
    return ''.join(lines)


def change_characters(rng: np.random.Generator, text: str) -> str:
    letters = list(text)
    for _ in range(int(rng.integers(1, 8))):
        at = int(rng.integers(len(letters)))
        letters[at] = str(rng.choice(list('();=,."*/+-#!\0\t éA0 \n$')))
    return ''.join(letters)


def change_numbers(rng: np.random.Generator, text: str) -> str:
    words = text.split(' ')
    numeric = [i for i, word in enumerate(words) if any(c.isdigit() for c in word)]
    for _ in range(int(rng.integers(1, 4))):
        if numeric:
            i = numeric[int(rng.integers(len(numeric)))]
            words[i] = str(rng.choice(ODD_NUMBERS)) + words[i][-1:].strip('0123456789.')
    return ' '.join(words)


def insert_junk(rng: np.random.Generator, text: str) -> str:
    junk = str(
        rng.choice(
            [
                '(' * 300,
                ')' * 50,
                '"',
                '/*',
                'BLOCK',
                'INCLUDE "../../secret.csg";',
                '\0',
                '%YAML',
                ';;;',
                'x' * 5000,
                '\ufeff',
                'END',
                '- - - -',
                '{[',
                '&a [*a, *a]',
            ]
        )
    )
    at = int(rng.integers(len(text) + 1))
    return text[:at] + junk + text[at:]


DAMAGE = (cut_or_repeat, change_characters, change_numbers, insert_junk)


def damaged_text(rng: np.random.Generator, text: str) -> str:
    for _ in range(int(rng.integers(1, 3))):
        if text:
            text = DAMAGE[int(rng.integers(len(DAMAGE)))](rng, text)
    return text


def damaged_bytes(rng: np.random.Generator, data: bytes) -> bytes:
    changed = bytearray(data)
    if rng.random() < 0.4:
        return bytes(changed[: int(rng.integers(len(changed)))])
    for at in rng.integers(0, len(changed), int(rng.integers(1, 30))):
        changed[at] = int(rng.integers(256))
    return bytes(changed)


class Source:
    """One kind of file: how to damage a good one, and how to read it."""

    def __init__(self, suffix: str, goods: list[bytes | str], read: Callable[[Path], object]) -> None:
        self.suffix, self.goods, self.read = suffix, goods, read

    def make(self, rng: np.random.Generator, folder: Path) -> Path:
        good = self.goods[int(rng.integers(len(self.goods)))]
        path = folder / f'file{self.suffix}'
        if isinstance(good, bytes):
            path.write_bytes(damaged_bytes(rng, good))
        else:
            path.write_text(damaged_text(rng, good), encoding='utf-8', newline='')
        return path


def picture(suffix: str, depth: type = np.uint8) -> bytes:
    """A good picture of a gradient."""
    done, data = cv2.imencode(suffix, np.linspace(0, np.iinfo(depth).max, 48 * 64).reshape(48, 64).astype(depth))
    assert done
    return bytes(data)


def array_file(shape: tuple[int, ...], values: int = 0) -> bytes:
    """A .npy file whose header says a shape, and which holds so many numbers."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {'descr': '<f8', 'fortran_order': False, 'shape': shape})
    return file.getvalue() + np.arange(float(values)).tobytes()


def mesh(kind: str) -> bytes:
    trimesh = optional('trimesh')
    made = trimesh.creation.cylinder(0.02, 0.05, sections=24).export(file_type=kind)
    return made if isinstance(made, bytes) else made.encode()


def optional(name: str):
    """An optional library; the run needs it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise SystemExit(f'{name} is not installed') from None


def read_case(path: Path) -> object:
    (path.parent / 'case').mkdir(exist_ok=True)
    (path.parent / 'case' / 'case.json').write_bytes(path.read_bytes())
    return load_case(path.parent / 'case')


CASE = '{"case": {"scene": "l_shape_v1", "seed": 3, "noise": 2.0, "label": "one"}, "limits": {"rotation_deg": 0.5}}'


def sources() -> dict[str, Source]:
    models = Path(csg_renderer.scene_path('l_shape')).parent
    buffer = io.BytesIO()
    model = csg_renderer.model_features(csg_renderer.load_models('cylinder_box')['cylinder_box'])
    with tempfile.TemporaryDirectory() as folder:
        model.save(Path(folder) / 'good.npz')
        buffer.write((Path(folder) / 'good.npz').read_bytes())
    cube = '\n'.join(
        [
            *(f'v {x} {y} {z}' for x in (0, 1) for y in (0, 1) for z in (0, 1)),
            'f 1 2 4 3',
            'f 5 7 8 6',
            'f 1 5 6 2',
            'f 3 4 8 7',
            'f 1 3 7 5',
            'f 2 6 8 4',
            '',
        ]
    )
    calibration = (resources.files('stereo_recovery') / 'data' / 'chessboard' / 'calibration.yaml').read_text()
    return {
        'scene': Source('.csg', [path.read_text() for path in sorted(models.glob('*.csg'))], csg_renderer.load_scene),
        'features': Source('.npz', [buffer.getvalue()], FeatureSet.load),
        'mesh': Source('.obj', [cube], csg_renderer.features_from_mesh),
        'calibration': Source('.yaml', [calibration], lambda path: load_cameras(path, (640, 480))),
        'program': Source(
            '.fpp',
            [program_source(name) for name in program_names()],
            lambda path: compile_program(path.read_text(encoding='utf-8')),
        ),
        'mesh_stl': Source('.stl', [mesh('stl')], csg_renderer.features_from_mesh),
        'mesh_ply': Source('.ply', [mesh('ply')], csg_renderer.features_from_mesh),
        'terrain_npy': Source('.npy', [array_file((12, 12), 144), array_file((10**6, 10**6))], read_heights),
        'terrain_png': Source('.png', [picture('.png', np.uint16)], read_heights),
        'terrain_asc': Source('.asc', ['ncols 3\nnrows 2\ncellsize 1\n1 2 3\n4 5 6\n'], read_heights),
        'array': Source('.npy', [array_file((5, 5), 25), array_file((2**40, 8))], lambda path: value_of(str(path))),
        **{
            f'picture_{suffix}': Source(f'.{suffix}', [picture(f'.{suffix}')], read_picture)
            for suffix in ('png', 'jpg', 'tiff', 'bmp', 'pgm')
        },
        'case': Source('.json', [CASE], read_case),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--files', type=int, default=5000)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--kind', help='only this kind')
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    kinds = {name: source for name, source in sources().items() if options.kind in (None, name)}
    outcomes: dict[str, Counter[str]] = {name: Counter() for name in kinds}
    slowest = dict.fromkeys(kinds, 0.0)
    bad = 0
    warnings.simplefilter('ignore')
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.files):
            name = list(kinds)[number % len(kinds)]
            path = kinds[name].make(rng, Path(folder))
            start = time.process_time()
            try:
                kinds[name].read(path)
                outcome = 'read'
            except (ValueError, OSError) as error:
                outcome = 'refused' if len(str(error)) > 10 else f'refused without words: {error!r}'
            except Exception as error:
                outcome = f'{type(error).__name__}: {str(error)[:100]}'
            took = time.process_time() - start
            slowest[name] = max(slowest[name], took)
            if outcome not in ('read', 'refused') or took > HANG_S:
                bad += 1
                kept = Path(tempfile.gettempdir()) / f'fuzz_{name}_{options.seed}_{number}{path.suffix}'
                kept.write_bytes(path.read_bytes())
                print(f'{kept}: {outcome} in {took:.1f} s')
            outcomes[name][outcome if outcome in ('read', 'refused') else 'FAILED'] += 1
    for name, counts in outcomes.items():
        print(f'{name}: {dict(counts)}, slowest {slowest[name]:.2f} s')
    print('every file read or refused with words' if not bad else f'FAILED: {bad} files')
    return int(bad > 0)


if __name__ == '__main__':
    sys.exit(main())
