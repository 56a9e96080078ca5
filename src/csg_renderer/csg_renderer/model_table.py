"""``model_table``: the thesis' models, its counts beside ours (Tables 4.3, 5.1, 5.3, 5.6, 6.1, 6.2; the oil rig: 4.12).

Every number of ours is worked out from the installed scene files when the command runs. The dimensions of the thesis'
models are lost, so a count that differs is shown as it is.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from msgs_py import FeatureKind

from .brep.model_features import boundary
from .language import SceneError, load_models, load_scene
from .visibility.hidden_lines import visible_fragments

# Thesis: primitives, half-spaces, faces (chapter 6: planar faces), edges, curves, axes. None: not stated.
MODELS: dict[str, tuple[int | None, int | None, int | None, int, int, int]] = {
    'chipped_block': (2, 12, 7, 15, 0, 0),
    'chair': (3, 18, 12, 30, 0, 0),
    'computer': (9, 54, 14, 32, 0, 0),
    'l_shape': (2, 12, 8, 18, 0, 0),
    'wedge': (3, 18, 7, 15, 0, 0),
    'plug': (8, 48, None, 54, 0, 0),
    'cylinder_box': (None, None, 7, 12, 2, 1),
    'lamp': (None, None, 13, 24, 3, 1),
    'tubes': (None, None, 10, 0, 10, 5),
    'widget': (None, None, None, 28, 3, 1),
    'oil_rig': (44, 264, None, 498, 0, 0),
}
# Thesis: visible edges, curves, axes of ideal data (5.6, the plug's from 5.11.5; chapter 6's data are recovered: 6.2).
VIEWS: dict[str, tuple[int, int, int]] = {
    'chipped_block_v1': (12, 0, 0),
    'chipped_block_v2': (9, 0, 0),
    'chair_v1': (20, 0, 0),
    'chair_v2': (21, 0, 0),
    'computer_v1': (26, 0, 0),
    'computer_v2': (17, 0, 0),
    'l_shape_v1': (15, 0, 0),
    'l_shape_v2': (9, 0, 0),
    'wedge_v1': (12, 0, 0),
    'wedge_v2': (8, 0, 0),
    'plug_v1': (40, 0, 0),
    'plug_v2': (13, 0, 0),
    'cylinder_box_v1': (9, 2, 1),
    'cylinder_box_v2': (11, 1, 0),
    'lamp_v1': (16, 3, 1),
    'lamp_v2': (15, 2, 1),
    'tubes_v1': (0, 8, 3),
}


def model_counts(path: str | Path) -> tuple[int, int, int, int, int, int]:
    """Primitives, half-spaces, planar faces, edges, curves, axes of the models of a scene file, summed."""
    total = np.zeros(6, int)
    for solid in load_models(path).values():
        found = boundary(solid)
        planar = sum(face.kind == 'plane' for face in found.details.faces)
        kinds = [int((found.features.kind == kind).sum()) for kind in FeatureKind]
        total += [len(solid.primitives), solid.halfspaces, planar, *kinds]
    primitives, halfspaces, faces, edges, curves, axes = total.tolist()
    return primitives, halfspaces, faces, edges, curves, axes


def view_counts(path: str | Path) -> tuple[int, int, int]:
    """Model edges, curves and axes of all objects that the scene's camera sees at least in part."""
    scene = load_scene(path)
    if scene.camera is None:
        raise SceneError(0, 0, 'has no CAMERA statement', file=str(path))
    placed = [(item.model, scene.camera_T_scene.compose(item.pose)) for item in scene.placements]
    total = np.zeros(3, int)
    for k, (solid, pose) in enumerate(placed):
        seen = visible_fragments(solid, pose, scene.camera, placed[:k] + placed[k + 1 :])
        kind = boundary(solid).features.kind[np.unique(seen.model_index)]
        total += [int((kind == wanted).sum()) for wanted in FeatureKind]
    edges, curves, axes = total.tolist()
    return edges, curves, axes


def table() -> dict[str, dict[str, dict[str, Any]]]:
    """{'models' | 'views': {name: {'ours': counts or None, 'thesis': counts, 'problem': text or None}}}."""
    return {
        'models': {name: _row(model_counts, name, thesis) for name, thesis in MODELS.items()},
        'views': {name: _row(view_counts, name, thesis) for name, thesis in VIEWS.items()},
    }


def _row(count: Any, name: str, thesis: tuple) -> dict[str, Any]:
    try:
        return {'ours': count(name), 'thesis': thesis, 'problem': None}
    except (OSError, ValueError) as error:
        return {'ours': None, 'thesis': thesis, 'problem': str(error)}


def as_markdown(rows: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Two tables, every cell ours | thesis; a cell that differs is marked with *."""
    lines = []
    for part, heads in (
        ('models', ('primitives', 'half-spaces', 'planar faces', 'edges', 'curves', 'axes')),
        ('views', ('visible edges', 'visible curves', 'visible axes')),
    ):
        lines += [f'| {part[:-1]} (ours / thesis) | ' + ' | '.join(heads) + ' |', '| --- ' * (len(heads) + 1) + '|']
        for name, row in rows[part].items():
            if row['problem']:
                cells = [f'- / {_number(value)}' for value in row['thesis']]
            else:
                cells = [
                    f'{ours} / {_number(thesis)}{"" if thesis in (ours, None) else " *"}'
                    for ours, thesis in zip(row['ours'], row['thesis'])
                ]
            lines.append(f'| {name} | ' + ' | '.join(cells) + ' |')
        lines += [f'{name}: {row["problem"]}' for name, row in rows[part].items() if row['problem']]
        lines.append('')
    return '\n'.join(lines)


def _number(value: int | None) -> str:
    return '-' if value is None else str(value)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: prints the tables."""
    parser = argparse.ArgumentParser('model_table', description="The thesis' models: its counts beside ours.")
    parser.add_argument('--json', metavar='FILE', help='also write the numbers to a JSON file')
    options = parser.parse_args(argv)
    rows = table()
    print(as_markdown(rows))
    if options.json:
        try:
            Path(options.json).write_text(json.dumps(rows, indent=1) + '\n', encoding='utf-8')
        except OSError as error:
            print(f'model_table: --json: {error}', file=sys.stderr)
            return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
