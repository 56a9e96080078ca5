"""``model_table``: the thesis' models, its counts beside ours (Tables 4.3, 5.1, 5.3, 5.6, 6.1, 6.2; the oil rig: 4.12).

Every number of ours is computed from the installed scene files when the command runs. The dimensions of the thesis'
models are lost, so a count that differs is shown as it is.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from msgs_py import FeatureKind
from msgs_py.commands import BAD_INPUT, DONE, CommandParser, as_text

from .brep.model_features import boundary
from .features import thesis_counts
from .features.thesis_counts import SCENES, VIEWS, ModelCounts
from .language import SceneError, load_models, load_scene
from .visibility.hidden_lines import visible_fragments

_OIL_RIG = SCENES['oil_rig']
# The oil rig is a scene for the ray caster, of blocks alone; the thesis counts its edges to say how large it is.
MODELS = {
    **thesis_counts.MODELS,
    'oil_rig': ModelCounts(_OIL_RIG.primitives, _OIL_RIG.halfspaces, None, _OIL_RIG.edges or 0, 0, 0),
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


def _row(count: Callable[[str], tuple[int, ...]], name: str, thesis: tuple[int | None, ...]) -> dict[str, Any]:
    """One row of a table; a scene that cannot be read is a row with a reason."""
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
    parser = CommandParser('model_table', description="The thesis' models: its counts beside ours.")
    parser.add_argument(
        '--json', metavar='FILE', nargs='?', const='-', help='write the numbers to a JSON file; to stdout without one'
    )
    options = parser.parse_args(argv)
    rows = table()
    print(as_markdown(rows), file=sys.stderr if options.json == '-' else sys.stdout)
    if options.json == '-':
        print(as_text(rows))
    elif options.json:
        try:
            Path(options.json).write_text(json.dumps(rows, indent=1) + '\n', encoding='utf-8')
        except OSError as error:
            print(f'model_table: --json: {error}', file=sys.stderr)
            return BAD_INPUT
    return DONE


if __name__ == '__main__':
    sys.exit(main())
