"""An example for every library program: an entry, and arguments that show what it does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from .library import program_names


class Example(NamedTuple):
    """Arguments of an entry, by name; the entry is None where the program has one only."""

    entry: str | None
    arguments: dict[str, Any]


def example(name: str) -> Example:
    """The example of a library program.

    Parameters
    ----------
    name : str

    Raises
    ------
    ValueError
        When the library has no such program.

    Examples
    --------
    >>> sorted(example('life').arguments)
    ['cells', 'generations']
    """
    if name not in _EXAMPLES:
        raise ValueError(f'example: {name!r} is not in the library ({", ".join(program_names())})')
    return _EXAMPLES[name]()


def picture(rows: int = 64, columns: int = 64) -> AnyArray:
    """(rows, columns) int16 grey values: a disc and a square, with a little noise that is always the same."""
    y, x = np.mgrid[:rows, :columns]
    grey = np.full((rows, columns), 40.0)
    grey[np.hypot(y - 0.42 * rows, x - 0.4 * columns) < 0.27 * rows] = 200.0
    grey[int(0.55 * rows) : int(0.85 * rows), int(0.5 * columns) : int(0.85 * columns)] = 120.0
    return (grey + np.random.default_rng(1).normal(0.0, 2.0, grey.shape)).round().astype(np.int16)


def l_shape_edges() -> tuple[FloatArray, FloatArray]:
    """Ends of the 18 edges of an L-shaped block, millimetres.

    Returns
    -------
    start, end : (18, 3) float64
    """
    outline = np.array([(0, 0), (60, 0), (60, 15), (20, 15), (20, 50), (0, 50)], dtype=np.float64)
    front = np.column_stack([outline, np.zeros(6)])
    back = front + (0.0, 0.0, 30.0)
    start = np.concatenate([front, back, front])
    end = np.concatenate([np.roll(front, -1, axis=0), np.roll(back, -1, axis=0), back])
    return start, end


def all_pairs(items: int) -> IntArray:
    """(P, 2) int64: the pairs of this many items, first below second, counted from 1."""
    return np.array([(a, b) for a in range(1, items + 1) for b in range(a + 1, items + 1)])


def feature_rows(start: FloatArray, end: FloatArray) -> FloatArray:
    """(n, 9): middle, unit direction and half length of edges, and 0 for the radii that they do not have."""
    half = 0.5 * np.linalg.norm(end - start, axis=1, keepdims=True)
    return np.hstack([0.5 * (start + end), 0.5 * (end - start) / half, half, np.zeros((len(start), 2))])


# Edges of the L-shape that the examples of matching see, and how far they may be off, millimetres.
_SEEN = np.array([0, 2, 3, 12, 4])
_OFF_MM = 0.3


def _tables_of_angles() -> BoolArray:
    """(18, 18, P) bool: pairs of edges of the L-shape as long as, and at the angle of, those of each seen pair."""
    rows = feature_rows(*l_shape_edges())
    same_length = np.abs(rows[:, None, 6] - rows[None, :, 6]) < 1.0
    cosine = np.abs(rows[:, 3:6] @ rows[:, 3:6].T)
    tables = [
        same_length[:, [a]] & same_length[:, [b]].T & (np.abs(cosine - cosine[a, b]) < 0.1) & ~np.eye(18, dtype=bool)
        for a, b in (_SEEN[pair - 1] for pair in all_pairs(len(_SEEN)))
    ]
    return np.stack(tables, axis=-1)


def _life() -> Example:
    return Example(None, {'cells': np.random.default_rng(3).random((64, 64)) < 0.3, 'generations': 12})


def _image() -> Example:
    return Example(None, {'image': picture()})


def _antialias() -> Example:
    rng = np.random.default_rng(2)
    samples = np.repeat(picture(32, 32)[:, :, None], 9, axis=2) + rng.normal(0.0, 30.0, (32, 32, 9))
    arguments = {'color': samples.astype('f4'), 'dist': np.ones((32, 32, 9), 'f4'), 'background': 0.0, 'smoothed': True}
    return Example(None, arguments)


def _csg_combine() -> Example:
    """A slab along the ray with a ball cut out of its front, seen from afar: distances in and out of both."""
    y, x = np.mgrid[:32, :32] / 15.5 - 1.0
    depth = np.sqrt(np.clip(0.5 - x * x - y * y, 0.0, None))
    enter = np.stack([np.full((32, 32), 4.0), 4.0 - depth], axis=-1)
    leave = np.stack([np.full((32, 32), 5.0), 4.0 + depth], axis=-1)
    times = {'in': enter.astype('f4'), 'out': leave.astype('f4')}
    return Example(None, {'operators': '00D', 'objects': [1, 2, 0], 'n': 3, 'leaves': 2, **times})


def _sorts() -> Example:
    pairs = all_pairs(8)
    sums = np.random.default_rng(5).integers(1, 60, len(pairs))
    arguments = {'matchsum': sums, 'datum2': pairs[:, 1], 'items': 8, 'n': len(pairs)}
    return Example('COMBINED', arguments)


def _tree() -> Example:
    """Five edges of an L-shape that one view shows."""
    pairs = all_pairs(len(_SEEN))
    arguments = {
        'match': _tables_of_angles(),
        'datum1': pairs[:, 0],
        'datum2': pairs[:, 1],
        'order': np.arange(1, len(pairs) + 1),
        'bins': np.zeros(18, bool),
        'pairs': len(pairs),
        'items': len(_SEEN),
        'signed': False,
        'most': 0,
        'noi': 10,
    }
    return Example(None, arguments)


def _pairwise() -> Example:
    """The same edges, turned a little and moved far, with all constraints."""
    start, end = l_shape_edges()
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    seen = [ends[_SEEN] @ turn.T + (20.0, 10.0, 300.0) for ends in (start, end)]
    pairs = all_pairs(len(_SEEN))
    arguments = {
        'model': feature_rows(start, end),
        'mkind': np.zeros(18, np.int32),
        'datum': feature_rows(*seen),
        'dkind': np.zeros(len(_SEEN), np.int32),
        'tolerance': np.tile([_OFF_MM, _OFF_MM, np.radians(3.0)], (len(_SEEN), 1)),
        'use': np.ones(5, bool),
        'signed': True,
        'datum1': pairs[:, 0],
        'datum2': pairs[:, 1],
        'pairs': len(pairs),
        'items': len(_SEEN),
        'edges': 18,
    }
    return Example(None, arguments)


def _raycast() -> Example:
    """A block with a ball cut out of a corner and a pin in it, 30 cm before the camera; metres."""
    sizes = np.array([(0.06, 0.05, 0.04), (0.025, 0.025, 0.025), (0.006, 0.006, 0.05)])
    places = np.array([(0.0, 0.0, 0.0), (0.055, 0.005, 0.0), (0.02, 0.03, -0.02)])
    # Row by row: the frame's axes as the camera sees them; the camera's place in the frame.
    turn = np.array([[0.8, -0.36, 0.48], [0.0, 0.8, 0.6], [-0.6, -0.48, 0.64]]).T
    camera = np.column_stack([turn, turn @ np.array([0.02, 0.0, -0.17]) + (0.03, 0.025, 0.02)])
    leaves = len(sizes)
    inverse = np.zeros((3, 4, leaves))
    for leaf, (size, place) in enumerate(zip(sizes, places)):
        inverse[:, :3, leaf], inverse[:, 3, leaf] = np.diag(1.0 / size), -place / size
    colours = np.array([(0.7, 0.5, 0.2), (0.2, 0.5, 0.7), (0.8, 0.2, 0.2)]).T
    arguments = {
        'kind': [0, 3, 1],
        'inverse': inverse,
        'leaves': leaves,
        'operators': '00D0U',
        'objects': [1, 2, 0, 3, 0],
        'n': 5,
        'colours': np.repeat(colours[:, None], 6, axis=1),
        'material': np.tile([[0.4], [0.6], [0.3], [12.0]], (1, leaves)),
        'light': np.array([[0.2], [-0.3], [-0.4]]),
        'lightcolour': np.ones((3, 1)),
        'lights': 1,
        'ambient': np.full(3, 0.5),
        'background': np.array([0.05, 0.05, 0.1]),
        'camera': camera,
        'centre': np.array([15.5, 15.5]),
        'focal': np.array([44.0, 44.0]),
        'close': 1e-10,
        'rows': 32,
        'columns': 32,
    }
    return Example(None, arguments)


def _validate() -> Example:
    """Three interpretations of five edges of the L-shape: the true one, one with a wrong edge, one with a bin."""
    start, end = l_shape_edges()
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    ends = np.stack([start[_SEEN], end[_SEEN]]) @ turn.T + (20.0, 10.0, 300.0)
    assigned = np.tile(_SEEN + 1, (3, 1))
    assigned[1, 2], assigned[2, 3] = 10, 0
    items = len(_SEEN)
    arguments = {
        'model': feature_rows(start, end).T,
        'datum': feature_rows(*ends).T,
        'kind': np.zeros(items, np.int32),
        'ends': ends.transpose(2, 0, 1),
        'assigned': assigned,
        'sign': np.ones((3, items), np.int32),
        'e': 18,
        'n': items,
        'm': 3,
        'sizeof': 90.0,
        'maxradius': 0.0,
        'fracdev': 0.01,
        'curvedev': 0.1,
    }
    return Example(None, arguments)


def _mandelbrot() -> Example:
    return Example(None, {'left': -2.2, 'top': -1.3, 'step': 0.041, 'limit': 16, 'count': np.zeros((64, 64), np.int16)})


_EXAMPLES: dict[str, Callable[[], Example]] = {
    'antialias': _antialias,
    'canny': _image,
    'csg_combine': _csg_combine,
    'laplacian_of_gaussian': _image,
    'life': _life,
    'mandelbrot': _mandelbrot,
    'pairwise': _pairwise,
    'raycast': _raycast,
    'roberts': _image,
    'sobel': _image,
    'sorts': _sorts,
    'tree': _tree,
    'validate': _validate,
}
