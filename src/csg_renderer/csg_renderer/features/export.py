"""Features to files that other programs read: DXF for CAD, JSON for everything else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from msgs_py import FeatureKind, FeatureSet

from ..brep.boundary import Boundary
from ..visibility.settings import CREASE_POINTS


def save_dxf(features: FeatureSet, path: str | Path, unit: float = 1e-3) -> None:
    """Write features as a DXF file (R12, ASCII): lines for edges and axes, 3D polylines for curves, one layer a kind.

    Parameters
    ----------
    features : FeatureSet
        Any frame, metres.
    path : str or path
    unit : float
        Metres per unit of the drawing; DXF R12 itself has no unit.
    """
    lines = ['0', 'SECTION', '2', 'ENTITIES']
    for k in range(len(features)):
        layer = FeatureKind(int(features.kind[k])).name
        points = features.polyline(k, CREASE_POINTS) / unit
        if len(points) == 2:
            lines += ['0', 'LINE', '8', layer, *_point(points[0], 10), *_point(points[1], 11)]
            continue
        lines += ['0', 'POLYLINE', '8', layer, '66', '1', *_point(np.zeros(3), 10), '70', '8']
        for point in points:
            lines += ['0', 'VERTEX', '8', layer, *_point(point, 10), '70', '32']
        lines += ['0', 'SEQEND', '8', layer]
    Path(path).write_text('\n'.join([*lines, '0', 'ENDSEC', '0', 'EOF', '']), encoding='ascii')


def _point(point: np.ndarray, code: int) -> list[str]:
    """Group codes and values of a point (3,)."""
    return [text for axis, value in enumerate(point) for text in (str(code + 10 * axis), f'{value:.9g}')]


def as_json(features: FeatureSet, found: Boundary | None = None) -> dict[str, Any]:
    """A model as plain data that JSON can hold, metres and radians.

    Parameters
    ----------
    features : FeatureSet
        Model frame.
    found : Boundary, optional
        Its boundary, which adds faces, angles, bounding box, area, volume and notices.

    Returns
    -------
    dict
    """
    rows = []
    for k in range(len(features)):
        kind = FeatureKind(int(features.kind[k]))
        row: dict[str, Any] = {'kind': kind.name}
        if kind == FeatureKind.CURVE:
            row |= {
                'centre': _list(features.start[k]),
                'normal': _list(features.directions[k]),
                'radii': _list(features.radii[k]),
                'arc': _list(features.arc[k]),
            }
            if np.isfinite(features.major_axis[k]).all():
                row['major_axis'] = _list(features.major_axis[k])
        else:
            row |= {'start': _list(features.start[k]), 'end': _list(features.end[k])}
        if features.has_covariance[k]:
            row['covariance'] = [_list(line) for line in features.covariance[k]]
        rows.append(row)
    out: dict[str, Any] = {'unit': 'm', 'features': rows}
    if found is None:
        return out
    details = found.details
    sides = [
        *zip(details.edge_faces, details.edge_angles),
        *((f, a) for f, a, k in zip(details.curve_faces, details.curve_angles, found.ellipse) if k),
    ]
    for row, (faces, angle) in zip(rows, sides):
        row |= {'faces': [int(f) for f in faces], 'dihedral_angle': float(angle) if np.isfinite(angle) else None}
    box = None if np.isnan(details.low).any() else [_list(details.low), _list(details.high)]
    return out | {
        'faces': [
            {'kind': face.kind, 'area': face.area, 'normal': None if face.normal is None else _list(face.normal)}
            for face in details.faces
        ],
        'vertices': [_list(v) for v in details.vertices],
        'bounding_box': box,
        'area': details.area,
        'volume': details.volume,
        'notices': list(found.notices + details.notices),
    }


def save_json(models: dict[str, dict[str, Any]], path: str | Path) -> None:
    """Write models as JSON.

    Parameters
    ----------
    models : dict
        By name, each as :func:`as_json` gives it.
    path : str or Path
    """
    Path(path).write_text(json.dumps(models, indent=1) + '\n', encoding='utf-8')


def _list(values: np.ndarray) -> list[float]:
    return [float(value) for value in values]
