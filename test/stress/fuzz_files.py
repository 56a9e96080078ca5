"""Thousands of malformed files and programs: each is read, or refused with words, within two seconds.

    python test/stress/fuzz_files.py --files 5000

Kinds: scene files, feature files (.npz), meshes (.obj), calibrations (YAML), array programs. Files are good ones with
bytes, lines and numbers changed, cut or repeated.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import numpy as np

import csg_renderer
from dap_emulator.fortran_plus import compile as compile_program
from dap_emulator.fortran_plus.library import program_names, program_source
from msgs_py import FeatureSet
from stereo_recovery.cameras.calibration import load_cameras

HANG_S = 2.0
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
