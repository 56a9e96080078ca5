"""``features MODEL``: the matching features of a scene file or a mesh as a table, a wire frame, DXF or JSON."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose
from msgs_py.commands import DONE, CommandParser, add_json, run_command

from .brep.model_features import boundary
from .brep.settings import WHOLE_TURN
from .features.drawing import Drawing, draw_mesh, draw_solid, save_drawing, view_from
from .features.export import as_json, save_dxf, save_json
from .features.mesh_features import mesh_features
from .features.terrain_edges import facet_edges
from .language import load_models, load_scene
from .mesh.files import MESH_SUFFIXES, cad_remedy, read_mesh
from .mesh.settings import CREASE_ANGLE
from .scene.solid import Solid
from .scene.terrain import Terrain

DRAWINGS = ('.png', '.svg', '.pdf')
OUTPUTS = (*DRAWINGS, '.dxf', '.json', '.npz')


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; 0 if all went well, 2 with one line on stderr if not."""
    return run_command('features', _run, features_parser().parse_args(argv))


def _run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints. Raises OSError or ValueError."""
    for output in options.output:
        if Path(output).suffix.lower() not in OUTPUTS:
            raise ValueError(f'--output: {output}: expected one of {", ".join(OUTPUTS)}')
    if not 0.0 < options.crease_angle < 180.0:
        raise ValueError(f'--crease-angle: expected degrees between 0 and 180, got {options.crease_angle:g}')
    if cad_remedy(options.model):
        raise ValueError(
            f'{options.model}: not a model file, expected .csg or one of {", ".join(MESH_SUFFIXES)}'
            + cad_remedy(options.model)
        )
    of_mesh = Path(options.model).suffix.lower() in MESH_SUFFIXES
    exported = _mesh(options) if of_mesh else _scene(options)
    _save_json(options, exported)
    return DONE, exported


def features_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = CommandParser(
        'features',
        description='Edges, planar curves and axes of a model, exactly from '
        'its CSG tree, or of a mesh within the error of its facets. Exit status 0: done, 2: bad input.',
    )
    parser.add_argument(
        'model', help='a scene (.csg; also the name of an installed one) or a mesh (.stl, .obj, .ply, .off)'
    )
    parser.add_argument(
        '-o',
        '--output',
        action='append',
        default=[],
        metavar='FILE',
        help='write a wire frame (.png, .svg, .pdf; hidden lines dashed), .dxf (mm), .json or .npz; '
        'may be repeated. Of several models each gets its name added',
    )
    parser.add_argument(
        '--look',
        nargs=3,
        type=float,
        default=(1.0, -1.6, 1.1),
        metavar=('X', 'Y', 'Z'),
        help='where to look from, model frame (default: %(default)s)',
    )
    parser.add_argument('--camera', action='store_true', help="draw from the scene file's own camera")
    parser.add_argument(
        '--crease-angle',
        type=float,
        default=np.degrees(CREASE_ANGLE),
        metavar='DEG',
        help='meshes and terrains: triangles that turn by more meet in a crease (default: %(default).0f)',
    )
    parser.add_argument('--scale', type=float, default=1.0, metavar='M', help='meshes: metres per unit of the file')
    parser.add_argument('-q', '--quiet', action='store_true', help='print counts, not the table')
    add_json(parser)
    return parser


def _scene(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """The features of every model of a scene file, printed and written; for JSON, by model."""
    models = load_models(options.model)
    grounds = [placement for placement in load_scene(options.model).placements if isinstance(placement.model, Terrain)]
    if not models and not grounds:
        print(f'{options.model}: draws no models')
    poses: dict[str, Pose] = {}
    camera = None
    if options.camera:
        scene = load_scene(options.model)
        camera = scene.camera
        if camera is None:
            raise ValueError(f'--camera: {options.model} has no CAMERA statement')
        for placement in scene.placements:
            poses.setdefault(placement.name, scene.camera_T_scene.compose(placement.pose))
    exported = {}
    for name, solid in models.items():
        found = boundary(solid)
        print(describe(name, found.features, solid, not options.quiet))
        exported[name] = as_json(found.features, found)
        for output in _paths(options.output, name, len(models) + len(grounds)):
            if output.suffix.lower() in DRAWINGS:
                save_drawing(_draw(solid, poses.get(name), camera, options.look), output, name)
            else:
                _save(found.features, output)
    for ground in grounds:
        if cast(Terrain, ground.model).bilinear:
            print(f'{ground.name}: a terrain of bilinear cells, which has no straight edges that are features')
        else:
            terrain = cast(Terrain, ground.model)
            edges = facet_edges(terrain, np.radians(options.crease_angle))
            exported[ground.name] = _written(ground.name, edges, *terrain.mesh(), options, len(models) + len(grounds))
    return exported


def _draw(solid: Solid, pose: Pose | None, camera: PinholeCamera | None, look: Sequence[float]) -> Drawing:
    if pose is None or camera is None:
        details = boundary(solid).details
        box = (np.zeros(3), np.ones(3)) if np.isnan(details.low).any() else (details.low, details.high)
        pose, camera = view_from(look, *box)
    return draw_solid(solid, pose, camera)


def _mesh(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """The features of a mesh, printed and written; for JSON, by model."""
    if not 0.0 < options.scale < np.inf:
        raise ValueError(f'--scale: expected metres per unit > 0, got {options.scale:g}')
    vertices, triangles = read_mesh(options.model)
    vertices = vertices * options.scale
    name = Path(options.model).stem
    features = mesh_features(vertices, triangles, np.radians(options.crease_angle))
    return {name: _written(name, features, vertices, triangles, options, 1)}


def _written(
    name: str,
    features: FeatureSet,
    vertices: np.ndarray,
    triangles: np.ndarray,
    options: argparse.Namespace,
    count: int,
) -> dict[str, Any]:
    """The features of triangles, printed and written as those of one of ``count`` models; returns them for JSON."""
    print(describe(name, features, None, not options.quiet))
    for output in _paths(options.output, name, count):
        if output.suffix.lower() in DRAWINGS:
            pose, camera = view_from(options.look, vertices.min(axis=0), vertices.max(axis=0))
            save_drawing(draw_mesh(features, vertices, triangles, pose, camera), output, name)
        else:
            _save(features, output)
    return as_json(features)


def _paths(outputs: Sequence[str], name: str, count: int) -> list[Path]:
    """The files of one model; JSON holds all models and is written once."""
    paths = [Path(output) for output in outputs if Path(output).suffix.lower() != '.json']
    return [path if count == 1 else path.with_name(f'{path.stem}_{name}{path.suffix}') for path in paths]


def _save(features: FeatureSet, path: Path) -> None:
    if path.suffix.lower() == '.dxf':
        save_dxf(features, path)
    else:
        features.save(path)


def _save_json(options: argparse.Namespace, exported: dict[str, dict[str, Any]]) -> None:
    for output in options.output:
        if Path(output).suffix.lower() == '.json':
            save_json(exported, output)


def describe(name: str, features: FeatureSet, solid: Solid | None = None, table: bool = True) -> str:
    """A model's features as text, millimetres and degrees.

    Parameters
    ----------
    name : str
        Of the model.
    features : FeatureSet
        Model frame, metres.
    solid : Solid, optional
        Adds its faces, volume and notices, and the dihedral angles of its edges.
    table : bool
        Give a line for every feature, and not only their numbers.
    """
    counts = ', '.join(
        f'{(features.kind == kind).sum()} {word}' for kind, word in zip(FeatureKind, ('edges', 'curves', 'axes'))
    )
    lines = [f'{name}: {counts}']
    angles = np.full(len(features), np.nan)
    if solid is not None:
        found = boundary(solid)
        details = found.details
        kinds = [face.kind for face in details.faces]
        text = ', '.join(f'{kinds.count(kind)} {kind}' for kind in dict.fromkeys(kinds)) or 'none'
        lines.append(
            f'  {len(solid.primitives)} primitives, {solid.halfspaces} half-spaces, '
            f'{len(kinds)} faces ({text}), {len(details.vertices)} vertices'
        )
        lines.append(f'  volume {details.volume * 1e9:.6g} mm3, surface {details.area * 1e6:.6g} mm2')
        if np.isfinite(details.low).all():
            lines.append(f'  box {_mm(details.low)} to {_mm(details.high)} mm')
        lines += [f'  note: {notice}' for notice in found.notices + details.notices]
        angles[: len(details.edge_angles)] = np.degrees(details.edge_angles)
        curves = details.curve_angles[found.ellipse]
        angles[len(details.edge_angles) : len(details.edge_angles) + len(curves)] = np.degrees(curves)
    if table and len(features):
        lines.append(
            f'  {"":3} kind  {"start or centre, mm":>29} {"end, mm, or normal":>29} {"length or radii":>17} angle, deg'
        )
        for k in range(len(features)):
            kind = FeatureKind(int(features.kind[k]))
            curve = kind == FeatureKind.CURVE
            second = ' '.join(f'{x:9.4f}' for x in features.directions[k]) if curve else _mm(features.end[k])
            size = '{:8.3f} {:8.3f}'.format(*features.radii[k] * 1e3) if curve else f'{features.lengths[k] * 1e3:17.3f}'
            angle = '' if np.isnan(angles[k]) else f'{angles[k]:.1f}'
            if curve and features.arc[k, 1] < WHOLE_TURN:
                angle += f'  arc of {np.degrees(features.arc[k, 1]):.1f}'
            lines.append(f'  {k:3} {kind.name:5} {_mm(features.start[k])} {second} {size} {angle}'.rstrip())
    return '\n'.join(lines)


def _mm(point: np.ndarray) -> str:
    return ' '.join(f'{x * 1e3 + 0.0:9.3f}' for x in point)


if __name__ == '__main__':
    sys.exit(main())
