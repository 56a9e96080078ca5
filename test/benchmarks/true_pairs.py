"""Stereo pairs of cameras and of a path tracer, with what is true of each: edges, circles, surfaces.

The pairs lie in two folders, photoreal/ and real/, under the folder that ``--data`` or the environment variable
STEREO_DATA names, or under ../shared beside the project. What is derived from a pair (contrasts, surfaces, samples) is
kept in out/pairs and made again when a file of the pair or this file changes.

Disparities are f B / Z, so that principal points that differ do not show in them.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from csg_renderer import Scene, load_models, render
from msgs_py import PinholeCamera, Pose, StereoRig

ROOT = Path(__file__).resolve().parents[2]
CACHE = ROOT / 'out' / 'pairs'
# Seeds of the path tracer that nobody develops on; the held-out pairs of cameras are not stored at all.
HELD = ('table0007', 'rims0005', 'dark0004')
# The fewest pairs that show every kind of difficulty: for a look between two changes.
QUICK = (
    'table0001',
    'metal0002',
    'rims0001',
    'dark0001',
    'print0001',
    'bin0002',
    'cubeA_01',
    'work3_02',
    'cube_06_28',
    'Books',
    'chessboard 03',
    'tea box 000',
)
# True edges and reported ones are sampled this densely, pixels (or pixels of disparity).
STEP = 0.7
# The step of grey across an edge is taken this far to both sides, and averaged so far along the edge, pixels.
BESIDE, ALONG = (2.0, 3.0), 6.0
# Fainter than this, grey levels, nothing is asked for.
LEAST_CONTRAST = 6.0
# On Middlebury the edges to find are LSD's that are this long, pixels, and this strong, grey levels.
LONG, STRONG = 25.0, 15.0
# Nearer to the rows than this, in either eye, an edge's own disparity is worth little.
NEAR_ROWS_DEG = 8.0
# About half of a circle has to be in view before it is asked for, and an arc has this many points to count as one.
HALF, LEAST_ARC = 0.45, 5
# The card box's folds are round and its scale uncertain; a moving camera with a rolling shutter took cube and tags.
SLACK_PX = {'teabox': 0.75, 'visp_cube': 0.25, 'tags': 0.25}
# Share of an edge of the printed cube that both eyes see, from which it counts as visible.
SEEN = 0.95


@dataclass(frozen=True, eq=False)
class TruePair:
    """A rectified pair and what is true of it; lengths in metres (chessboards: squares), left optical frame.

    left, right : (h, w) uint8
    edges : (n, 2, 3) float64, straight edges that both eyes see; none where only a surface is known
    point, direction : (s, 3) float64, samples of all that is to be found, with the unit direction in space (NaN: known
        in the image only); pixel, slope : (s, 2) float64, the same in the left image
    near, far : (s,) float64, disparity on either side of the edge; equal where the edge is known in space
    edge : (s,) intp, row of edges, or -1 - number for an edge known in the image or a curve
    weight : (s,) float64, pixels of the left image; contrast : (s,) float64, grey levels, weaker eye; flat : (s,)
        bool, near the rows; asked : (s,) bool, counts for the recall
    surface : (h, w) float32, disparity of the surface in the left image, NaN where there is none or none known
    judged : (h, w) bool, where a report that lies on nothing true is wrong
    parts : (h, w) bool, the part of judged where the known objects themselves are seen
    circle : (c, 12) float64: centre, normal, radii, share that is seen, diameter in pixels, contrast, asked for
    plane : (4,) float64, a board: normal . p = plane[3]; NaN for other pairs
    """

    name: str
    family: str
    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    edges: np.ndarray
    point: np.ndarray
    direction: np.ndarray
    pixel: np.ndarray
    slope: np.ndarray
    near: np.ndarray
    far: np.ndarray
    edge: np.ndarray
    weight: np.ndarray
    contrast: np.ndarray
    flat: np.ndarray
    asked: np.ndarray
    surface: np.ndarray
    judged: np.ndarray
    parts: np.ndarray
    circle: np.ndarray
    plane: np.ndarray

    @property
    def slack(self) -> float:
        """By how much the truth itself may be off, pixels of disparity."""
        return SLACK_PX.get(self.family, 0.0)

    @property
    def scale(self) -> float:
        """f B, so that a disparity is scale / Z."""
        return self.rig.left.fx * self.rig.baseline

    def disparity_window(self) -> tuple[float, float]:
        """Least and largest disparity of what is known, with a margin: what a peer has to be told."""
        known = np.concatenate([self.near, self.far, self.surface[np.isfinite(self.surface)].astype(float)])
        low, high = np.quantile(known, [0.002, 0.998])
        return 0.8 * float(low), 1.2 * float(high)


# -- finding the data ------------------------------------------------------------------------------------------


def data_folder(given: str | Path | None = None) -> Path:
    """The folder with photoreal/ and real/. Raises FileNotFoundError with a sentence when there is none."""
    named = given or os.environ.get('STEREO_DATA')
    folder = Path(named) if named else ROOT.parent / 'shared'
    if not named and not folder.is_dir():
        # A work tree of git may stand elsewhere than the project it belongs to.
        folder = next((p / 'shared' for p in (_main_tree().parent,) if (p / 'shared').is_dir()), folder)
    if not (folder / 'photoreal').is_dir() and not (folder / 'real').is_dir():
        raise FileNotFoundError(
            f'{folder}: no folder photoreal/ or real/ with stereo pairs there; name the folder that has them with '
            '--data FOLDER or in the environment variable STEREO_DATA'
        )
    return folder


def _main_tree() -> Path:
    """The project's own folder when this is one of its work trees."""
    link = ROOT / '.git'
    if link.is_file():
        return Path(link.read_text().split('gitdir:')[1].strip()).parents[2]
    return ROOT


# -- what is in a pair -----------------------------------------------------------------------------------------


@dataclass
class _Raw:
    """A pair as its files have it: edges with contrast (NaN: to be measured), polylines of curves with theirs."""

    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    edges: np.ndarray
    contrast: np.ndarray
    asked: np.ndarray
    curves: list[np.ndarray]
    circle: np.ndarray
    surface: np.ndarray
    judged: np.ndarray
    plane: np.ndarray
    parts: np.ndarray | None = None


def _raw(left: np.ndarray, right: np.ndarray, rig: StereoRig, edges: Any = (), **more: Any) -> _Raw:
    edges = np.asarray(edges, float).reshape(-1, 2, 3)
    raw = _Raw(
        left,
        right,
        rig,
        edges,
        np.full(len(edges), np.nan),
        np.ones(len(edges), bool),
        [],
        np.zeros((0, 12)),
        np.full(left.shape, np.nan, np.float32),
        np.zeros(left.shape, bool),
        np.full(4, np.nan),
    )
    for name, value in more.items():
        setattr(raw, name, value)
    return raw


def _grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise OSError(f'{path}: not a readable image')
    return image


def _rig(camera: dict[str, Any]) -> StereoRig:
    size = camera['width'], camera['height']
    focal = camera['fx'], camera['fy']
    left = PinholeCamera(*size, *focal, camera['cx'], camera['cy'])
    right = PinholeCamera(*size, *focal, camera.get('cx_right', camera['cx']), camera['cy'])
    return StereoRig(left, right, camera['baseline'])


def _photoreal(folder: Path, name: str) -> _Raw:
    truth = json.loads((folder / 'truth' / f'{name}.json').read_text())
    left, right = (_grey(folder / 'images' / f'{name}_{side}.png') for side in ('left', 'right'))
    rig = _rig(truth['camera'])
    depth = cv2.imread(str(folder / 'truth' / f'{name}_depth.png'), cv2.IMREAD_UNCHANGED).astype(np.float32) * 1e-4
    depth = np.repeat(np.repeat(depth, 2, axis=0), 2, axis=1)[: left.shape[0], : left.shape[1]]
    surface = np.where(depth > 0.0, rig.left.fx * rig.baseline / np.maximum(depth, 1e-6), np.nan)
    circle = [
        [*c['centre'], *c['normal'], *c['radii'], c['fraction_visible'], c['pixels'], c['contrast'], 0.0]
        for c in truth['curves']
    ]
    circle = np.array(circle).reshape(-1, 12)
    # Half of it in view, and enough of it to be a curve.
    circle[:, 11] = (circle[:, 8] >= HALF) & (circle[:, 10] >= LEAST_CONTRAST)
    curves = [_arc(c) for c in truth['curves']]
    raw = _raw(
        left,
        right,
        rig,
        [[e['start'], e['end']] for e in truth['edges']],
        circle=circle,
        curves=[x for x in (_shown(c, surface, rig) for c in curves) if len(x) > 1],
        surface=surface.astype(np.float32),
        judged=np.ones(left.shape, bool),
    )
    raw.contrast = np.array([e['contrast'] for e in truth['edges']], float)
    return raw


def _arc(curve: dict[str, Any]) -> np.ndarray:
    first = np.array(curve['major'])
    second = np.cross(curve['normal'], first)
    angle = curve['arc'][0] + np.linspace(0.0, 1.0, 181) * curve['arc'][1]
    major, minor = curve['radii']
    return (
        np.array(curve['centre']) + (major * np.cos(angle))[:, None] * first + (minor * np.sin(angle))[:, None] * second
    )


def _shown(points: np.ndarray, surface: np.ndarray, rig: StereoRig) -> np.ndarray:
    """The longest run of a curve's points that nothing hides from the left eye."""
    pixels = np.round(rig.left.project(points)).astype(int)
    h, w = surface.shape
    inside = ((pixels >= 1) & (pixels < [w - 1, h - 1])).all(axis=1)
    column, row = np.clip(pixels, 1, [w - 2, h - 2]).T
    here = np.stack([surface[row + dv, column + du] for dv in (-1, 0, 1) for du in (-1, 0, 1)])
    least = np.nanmin(np.where(np.isfinite(here), here, np.inf), axis=0)
    seen = inside & (rig.left.fx * rig.baseline / points[:, 2] > least - 0.7)
    if seen.all():
        return points
    start = int(np.argmin(seen))
    turned = np.roll(seen, -start)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], turned.astype(int), [0]])))
    if len(edges) == 0:
        return points[:0]
    first, last = max(zip(edges[::2], edges[1::2]), key=lambda run: run[1] - run[0])
    return np.roll(points, -start, axis=0)[first:last]


def _openvgr(folder: Path, name: str) -> _Raw:
    truth = json.loads((folder / f'{name}.json').read_text())
    left, right = (_grey(folder / f'{name}_{side}.png') for side in ('left', 'right'))
    rig = _rig(truth['camera'])
    solids = []
    for instance in truth['instances']:
        solid = next(iter(load_models(folder / 'models' / f'{instance["part"]}.csg').values()))
        solids.append(solid.transformed(Pose(np.array(instance['R']), np.array(instance['t']))))
    depth = render(Scene(solids), rig.left).depth.astype(float)
    part = np.isfinite(depth)
    normal, d = np.array(truth['table']['normal']), truth['table']['d']
    with np.errstate(divide='ignore', invalid='ignore'):
        table = d / (rig.left.rays(rig.left.pixel_grid()).reshape(*left.shape, 3) @ normal)
    table[~(table > 0.0)] = np.nan
    surface = rig.left.fx * rig.baseline / np.fmin(depth, table)
    # One set stands on paper before a cloth whose place is not known; the other on a plate that fills the picture.
    judged = np.ones(left.shape, bool)
    if truth['scene'] in ('cubeA', 'can190A'):
        judged = cv2.dilate(part.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    straight = [v['points'] for v in truth['visible'] if v['kind'] == 'edge']
    curves = [np.array(v['points']) for v in truth['visible'] if v['kind'] == 'curve']
    curves = [c for c in curves if len(c) >= LEAST_ARC]
    return _raw(
        left,
        right,
        rig,
        straight,
        curves=curves,
        circle=np.array([_circle_through(c, rig) for c in curves]).reshape(-1, 12),
        surface=surface.astype(np.float32),
        judged=judged,
        parts=judged & (cv2.dilate(part.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0),
    )


def _circle_through(points: np.ndarray, rig: StereoRig) -> list[float]:
    """The circle of an arc in space; its contrast is measured later."""
    middle = points.mean(axis=0)
    first, second, normal = np.linalg.svd(points - middle)[2]
    x, y = (points - middle) @ first, (points - middle) @ second
    a, b, c = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones(len(x))]), x * x + y * y, rcond=None)[0]
    radius = np.sqrt(c + a * a + b * b)
    centre = middle + a * first + b * second
    share = np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / (2.0 * np.pi * radius)
    pixels = 2.0 * radius * rig.left.fx / centre[2]
    return [*centre, *normal, radius, radius, min(share, 1.0), pixels, np.nan, float(share >= HALF)]


def _cube(folder: Path, name: str) -> _Raw:
    truth = next(t for t in json.loads((folder / 'truth.json').read_text()) if t['name'] == name)
    left, right = (_grey(folder / f'{name}_{side}.png') for side in ('left', 'right'))
    rig = _rig(json.loads((folder / f'{name}_camera.json').read_text()))
    cube = truth['cube']
    share = np.array(cube['seen_by_both'])
    edges = np.array(cube['edges'])
    faces = []
    rotation, centre = np.array(cube['R']), np.array(cube['t'])
    for axis in range(3):
        for side in (-0.5, 0.5):
            normal = rotation[:, axis] * np.sign(side)
            middle = centre + normal * 0.5 * cube['size'][axis]
            if normal @ middle < 0.0:
                across = [0.5 * cube['size'][a] * rotation[:, a] for a in range(3) if a != axis]
                faces.append(np.array([middle + i * across[0] + j * across[1] for i, j in _AROUND]))
    surface = _faces_disparity(faces, rig)
    # Behind the cube there are things whose place is not known.
    return _raw(
        left,
        right,
        rig,
        edges[share > 0.05],
        asked=share[share > 0.05] >= SEEN,
        surface=surface,
        judged=_inner(surface),
    )


def _inner(surface: np.ndarray) -> np.ndarray:
    """Where a surface is known and its outline is not near: a report there may lie on what is behind."""
    return cv2.erode(np.isfinite(surface).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0


# The rest of the wall's pictures disagree with its plane by more than half a pixel: the camera moved too fast.
TAG_PAIRS = ('00_26', '02_24', '04_24', '06_28', '08_26', '08_28', '54_48', '64_30')


def _tag_names(folder: Path) -> list[str]:
    # Older versions of OpenCV have no detector of tags.
    here = hasattr(cv2, 'aruco') and hasattr(cv2.aruco, 'ArucoDetector')
    return [f'tags {pair}' for pair in TAG_PAIRS if here and (folder / f'cube_{pair}_left.png').exists()]


def _tags(folder: Path, name: str) -> _Raw:
    """The wall behind the cube: tags that OpenCV reads in both eyes lie in one plane of disparities."""
    stem = f'cube_{name.split()[-1]}'
    left, right = (_grey(folder / f'{stem}_{side}.png') for side in ('left', 'right'))
    rig = _rig(json.loads((folder / f'{stem}_camera.json').read_text()))
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), settings)
    seen = []
    for image in (left, right):
        corners, numbers, _ = detector.detectMarkers(image)
        seen.append({int(n): c.reshape(4, 2).astype(float) for n, c in zip(np.ravel(numbers), corners)})
    both = sorted(set(seen[0]) & set(seen[1]))
    at, other = (np.concatenate([eye[n] for n in both]) for eye in seen)
    plane = np.linalg.lstsq(np.column_stack([at, np.ones(len(at))]), (at - other)[:, 0], rcond=None)[0]
    space = rig.triangulate(at, at[:, 0] - np.column_stack([at, np.ones(len(at))]) @ plane).reshape(-1, 4, 3)
    edges = np.stack([space, np.roll(space, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    surface = _faces_disparity(list(space), rig)
    return _raw(left, right, rig, edges, surface=surface, judged=_inner(surface))


_AROUND = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def _faces_disparity(faces: list[np.ndarray], rig: StereoRig) -> np.ndarray:
    """(h, w) float32: the disparity of planar faces that do not hide each other, NaN elsewhere."""
    shape = rig.left.height, rig.left.width
    rays = rig.left.rays(rig.left.pixel_grid()).reshape(*shape, 3)
    result = np.full(shape, np.nan, np.float32)
    for face in faces:
        normal = np.cross(face[1] - face[0], face[3] - face[0])
        mask = np.zeros(shape, np.uint8)
        cv2.fillPoly(mask, [np.round(rig.left.project(face)).astype(np.int32)], 1)
        with np.errstate(divide='ignore', invalid='ignore'):
            disparity = rig.left.fx * rig.baseline * (rays @ normal) / (normal @ face[0])
        result[mask > 0] = disparity[mask > 0]
    return result


def _middlebury(folder: Path, name: str) -> _Raw:
    given = json.loads((folder / 'calibration.json').read_text())[name]
    left, right = (_grey(folder / f'{name}_{side}.png') for side in ('left', 'right'))
    rig = _rig(given['camera'])
    stored = cv2.imread(str(folder / f'{name}_disparity.png'), cv2.IMREAD_UNCHANGED)
    stored = (stored if stored.ndim == 2 else stored[..., 0]).astype(np.float32)
    disparity = stored / given['disparity_scale'] - (rig.left.cx - rig.right.cx)
    known = stored > 0
    return _raw(left, right, rig, surface=np.where(known, disparity, np.nan).astype(np.float32), judged=known)


# Where the printed pattern ends, squares; the inner corners (i, j) lie at (i, j, 0).
_COLUMNS, _ROWS = np.array([-0.52, *range(9), 8.48]), np.array([-0.96, *range(6), 5.94])


def _chessboard(folder: Path, name: str) -> _Raw:
    number = name.split()[-1]
    left, right = (_grey(folder / f'{side}{number}_rect.png') for side in ('left', 'right'))
    given = json.loads((folder / 'calibration.json').read_text())['rectified']
    size = left.shape[1], left.shape[0]
    camera = PinholeCamera(*size, given['f'], given['f'], given['cx'], given['cy'])
    rig = StereoRig.symmetric(camera, given['baseline'])
    joint = json.loads((folder / 'board_poses.json').read_text())[number]['joint']
    pose = Pose.from_rotation_vector(joint['rvec'], joint['tvec'])
    pieces = [[(x, a, 0), (x, b, 0)] for x in range(9) for a, b in zip(_ROWS[:-1], _ROWS[1:])]
    pieces += [[(a, y, 0), (b, y, 0)] for y in range(6) for a, b in zip(_COLUMNS[:-1], _COLUMNS[1:])]
    ends = pose.apply(np.array(pieces, float).reshape(-1, 3)).reshape(-1, 2, 3)
    outline = pose.apply([[_COLUMNS[i], _ROWS[j], 0.0] for i, j in ((0, 0), (-1, 0), (-1, -1), (0, -1))])
    surface = _faces_disparity([outline], rig)
    normal = pose.rotation[:, 2]
    plane = np.array([*normal, normal @ pose.translation])
    return _raw(left, right, rig, ends, surface=surface, judged=np.isfinite(surface), plane=plane)


def _teabox(folder: Path, name: str) -> _Raw:
    number = name.split()[-1]
    left, right = (_grey(folder / f'{side}{number}_rect.png') for side in ('left', 'right'))
    given = json.loads((folder / 'calibration.json').read_text())['rectified']
    camera = PinholeCamera(*given['size'], given['f'], given['f'], given['cx'], given['cy'])
    rig = StereoRig.symmetric(camera, given['baseline_m_corrected'])
    reference = json.loads((folder / 'box_poses.json').read_text())
    entry = reference['poses'][number]
    vertices = Pose.from_rotation_vector(entry['rvec'], entry['tvec_m']).apply(np.array(reference['vertices_m'], float))
    surface = _faces_disparity([vertices[[0, 1, 2, 3]], vertices[[0, 1, 5, 4]]], rig)
    # The card's folds are round: a report just inside the outline may lie on the board behind it.
    edges = vertices[np.array(reference['visible_edges'])]
    return _raw(left, right, rig, edges, surface=surface, judged=_inner(surface))


# -- families --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Family:
    """Where the pairs of a family lie, what they are called, the files of one, and how one is read."""

    folder: str
    names: Callable[[Path], list[str]]
    files: str
    read: Callable[[Path, str], _Raw]
    also: tuple[str, ...] = ()


def _stems(pattern: str, cut: str) -> Callable[[Path], list[str]]:
    return lambda folder: sorted(path.name[: -len(cut)] for path in folder.glob(pattern))


def _numbered(prefix: str) -> Callable[[Path], list[str]]:
    return lambda folder: [f'{prefix} {path.name[4:-9]}' for path in sorted(folder.glob('left*_rect.png'))]


_REAL = {
    'openvgr': Family('real/openvgr', _stems('*_left.png', '_left.png'), '{}*', _openvgr, ('models/*.csg',)),
    'visp_cube': Family('real/visp_cube/pairs', _stems('*_left.png', '_left.png'), '{}*', _cube, ('truth.json',)),
    'tags': Family('real/visp_cube/pairs', _tag_names, '*_{}_*', _tags),
    'middlebury': Family(
        'real/middlebury', _stems('*_left.png', '_left.png'), '{}*', _middlebury, ('calibration.json',)
    ),
    'chessboards': Family('real/chessboard', _numbered('chessboard'), '*{}_rect.png', _chessboard, ('*.json',)),
    'teabox': Family('real/teabox', _numbered('tea box'), '*{}_rect.png', _teabox, ('*.json',)),
}
PHOTOREAL_KINDS = ('table', 'metal', 'rims', 'dark', 'print', 'bin', 'clutter')
_PHOTOREAL = {
    kind: Family(
        'photoreal',
        lambda folder, kind=kind: sorted(p.name[:-9] for p in (folder / 'images').glob(f'{kind}[0-9]*_left.png')),
        '*/{}*',
        _photoreal,
    )
    for kind in PHOTOREAL_KINDS
}
FAMILIES = {**_PHOTOREAL, **_REAL}
REAL = tuple(_REAL)


def families_of(words: list[str] | tuple[str, ...]) -> list[str]:
    """Names of families; 'photoreal', 'real' and 'all' stand for several. Raises ValueError for an unknown one."""
    several = {'photoreal': PHOTOREAL_KINDS, 'real': REAL, 'all': tuple(FAMILIES)}
    result: list[str] = []
    for word in words:
        if word not in several and word not in FAMILIES:
            raise ValueError(f'no family {word!r}; there are {", ".join((*FAMILIES, *several))}')
        result += [name for name in several.get(word, (word,)) if name not in result]
    return result


def pair_names(data: Path, family: str, held: bool = False) -> list[str]:
    """The pairs of a family that are on this machine; held-out ones only when asked for."""
    folder = data / FAMILIES[family].folder
    return [name for name in FAMILIES[family].names(folder) if held or name not in HELD] if folder.is_dir() else []


def load_pairs(
    data: Path, families: list[str], scenes: list[str] | None = None, held: bool = False
) -> Iterator[TruePair]:
    """Pairs one after the other; scenes: those whose name begins with one of these."""
    for family in families:
        for name in pair_names(data, family, held):
            if not scenes or any(name.startswith(scene) for scene in scenes):
                yield load_pair(data, family, name)


def load_pair(data: Path, family: str, name: str) -> TruePair:
    """A pair with its derived truth, from the cache when its files are as they were."""
    entry = FAMILIES[family]
    folder = data / entry.folder
    files = [*folder.glob(entry.files.format(name.split()[-1])), *(p for also in entry.also for p in folder.glob(also))]
    state = ''.join(f'{p}{p.stat().st_size}{p.stat().st_mtime_ns}' for p in sorted(files)) + _OWN_TEXT + cv2.__version__
    path = CACHE / f'{name.replace(" ", "_")}-{hashlib.sha256(state.encode()).hexdigest()[:16]}.npz'
    try:
        with np.load(path) as stored:
            return _from_arrays({key: stored[key] for key in stored.files}, name, family)
    except (OSError, ValueError, KeyError, EOFError):
        pass
    pair = _derived(entry.read(folder, name), name, family)
    CACHE.mkdir(parents=True, exist_ok=True)
    for old in CACHE.glob(f'{name.replace(" ", "_")}-*.npz'):
        old.unlink(missing_ok=True)
    # Written beside and renamed: two runs may want the same pair.
    beside = path.with_suffix(f'.{os.getpid()}.npz')
    np.savez(beside, **_as_arrays(pair))
    beside.replace(path)
    return pair


_OWN_TEXT = Path(__file__).read_text()


def _as_arrays(pair: TruePair) -> dict[str, np.ndarray]:
    arrays = {f.name: getattr(pair, f.name) for f in fields(pair) if f.name not in ('name', 'family', 'rig')}
    cameras = [(c.width, c.height, c.fx, c.fy, c.cx, c.cy) for c in (pair.rig.left, pair.rig.right)]
    return {**arrays, 'cameras': np.array(cameras), 'baseline': np.array(pair.rig.baseline)}


def _from_arrays(arrays: dict[str, np.ndarray], name: str, family: str) -> TruePair:
    cameras = [PinholeCamera(int(row[0]), int(row[1]), *map(float, row[2:])) for row in arrays.pop('cameras')]
    rig = StereoRig(cameras[0], cameras[1], float(arrays.pop('baseline')))
    return TruePair(name=name, family=family, rig=rig, **arrays)


# -- what follows from it --------------------------------------------------------------------------------------


def _derived(raw: _Raw, name: str, family: str) -> TruePair:
    if family == 'middlebury':
        samples = _image_samples(raw)
    else:
        samples = _space_samples(raw)
    circle = raw.circle.copy()
    for number in np.flatnonzero(np.isnan(circle[:, 10])):
        own = samples['contrast'][samples['edge'] == -1 - number]
        circle[number, 10] = np.median(own) if len(own) else 0.0
        circle[number, 11] *= circle[number, 10] >= LEAST_CONTRAST
    return TruePair(
        name=name,
        family=family,
        left=raw.left,
        right=raw.right,
        rig=raw.rig,
        edges=raw.edges,
        surface=raw.surface,
        judged=raw.judged,
        parts=raw.judged if raw.parts is None else raw.parts,
        circle=circle,
        plane=raw.plane,
        **samples,
    )


def _space_samples(raw: _Raw) -> dict[str, np.ndarray]:
    """Samples of straight edges, and of curves (never asked for: circles are counted, not measured by length)."""
    lists: dict[str, list[np.ndarray]] = {key: [] for key in ('point', 'direction', 'edge', 'weight', 'given', 'asked')}
    pieces = [(i, edge, raw.contrast[i], raw.asked[i]) for i, edge in enumerate(raw.edges)]
    for number, curve in enumerate(raw.curves):
        pieces += [(-1 - number, run, np.nan, False) for run in zip(curve[:-1], curve[1:])]
    scale = raw.rig.left.fx * raw.rig.baseline
    for number, (start, end), contrast, asked in pieces:
        pixels = raw.rig.left.project(np.stack([start, end]))
        length = float(np.linalg.norm(pixels[1] - pixels[0]))
        count = int(np.ceil(max(length, abs(scale / start[2] - scale / end[2])) / STEP)) + 1
        # Evenly in the image, where 1 / Z is linear along a line.
        t = (np.arange(count) + 0.5) / count
        inverse = (1 - t) / start[2] + t / end[2]
        lists['point'].append((np.outer((1 - t) / start[2], start) + np.outer(t / end[2], end)) / inverse[:, None])
        lists['direction'].append(np.tile((end - start) / np.linalg.norm(end - start), (count, 1)))
        lists['edge'].append(np.full(count, number))
        lists['weight'].append(np.full(count, length / count))
        lists['given'].append(np.full(count, contrast))
        lists['asked'].append(np.full(count, asked))
    if not pieces:
        return _no_samples()
    joined = {key: np.concatenate(value) for key, value in lists.items()}
    point, direction = joined['point'], joined['direction']
    pixel, right = raw.rig.project(point)
    slope, slope_right = (_image_slope(point, direction, raw.rig, eye) for eye in (0.0, raw.rig.baseline))
    measured = np.fmin(
        _contrast(raw.left, pixel, slope, joined['edge']), _contrast(raw.right, right, slope_right, joined['edge'])
    )
    contrast = np.where(np.isfinite(joined['given']), joined['given'], measured)
    inside = raw.rig.left.contains(pixel) & raw.rig.right.contains(right)
    disparity = scale / point[:, 2]
    least = np.sin(np.radians(NEAR_ROWS_DEG))
    return {
        'point': point,
        'direction': direction,
        'pixel': pixel,
        'slope': slope,
        'near': disparity,
        'far': disparity,
        'edge': joined['edge'],
        'weight': joined['weight'],
        'contrast': contrast,
        'flat': (np.abs(slope[:, 1]) < least) | (np.abs(slope_right[:, 1]) < least),
        'asked': joined['asked'].astype(bool) & inside & (contrast >= LEAST_CONTRAST),
    }


def _no_samples() -> dict[str, np.ndarray]:
    shapes = {'point': (0, 3), 'direction': (0, 3), 'pixel': (0, 2), 'slope': (0, 2)}
    result = {key: np.zeros(shape) for key, shape in shapes.items()}
    result |= {key: np.zeros(0) for key in ('near', 'far', 'weight', 'contrast')}
    return result | {'edge': np.zeros(0, int), 'flat': np.zeros(0, bool), 'asked': np.zeros(0, bool)}


def _image_slope(point: np.ndarray, direction: np.ndarray, rig: StereoRig, shift: float) -> np.ndarray:
    """(s, 2) unit direction of a line in the image of the eye at ``shift`` along x."""
    seen = point - [shift, 0.0, 0.0]
    slope = direction[:, :2] * seen[:, 2:] - seen[:, :2] * direction[:, 2:]
    slope *= [rig.left.fx, rig.left.fy]
    return slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)


def _contrast(image: np.ndarray, pixel: np.ndarray, slope: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """(s,) float64: the step of grey across the edge, averaged along it."""
    normal = np.column_stack([-slope[:, 1], slope[:, 0]])
    step = np.zeros(len(pixel))
    for side in (-1.0, 1.0):
        for away in BESIDE:
            at = (pixel + side * away * normal).astype(np.float32)
            values = cv2.remap(image, at[:, None, 0], at[:, None, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            step += side * values[:, 0].astype(float) / len(BESIDE)
    half = round(ALONG / STEP)
    sums = np.concatenate([[0.0], np.cumsum(step)])
    index = np.arange(len(step))
    # Samples of one edge follow each other.
    first = np.concatenate([[0], np.flatnonzero(np.diff(edge)) + 1, [len(edge)]])
    which = np.searchsorted(first, index, side='right') - 1
    low, high = np.maximum(index - half, first[which]), np.minimum(index + half + 1, first[which + 1])
    return np.abs((sums[high] - sums[low]) / (high - low))


def _image_samples(raw: _Raw) -> dict[str, np.ndarray]:
    """Samples of the left image's long strong segments whose surface is known on a side at least."""
    lines = line_segments(raw.left)
    lines = lines[np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]) >= LONG]
    pixel, slope, edge, weight = [], [], [], []
    for number, line in enumerate(lines):
        length = float(np.hypot(line[2] - line[0], line[3] - line[1]))
        count = int(np.ceil(length / STEP)) + 1
        t = ((np.arange(count) + 0.5) / count)[:, None]
        pixel.append((1 - t) * line[:2] + t * line[2:])
        slope.append(np.tile((line[2:] - line[:2]) / length, (count, 1)))
        edge.append(np.full(count, number))
        weight.append(np.full(count, length / count))
    p, s, e, w = (np.concatenate(x) for x in (pixel, slope, edge, weight))
    contrast = _contrast(raw.left, p, s, e)
    strong = np.array([np.median(contrast[e == k]) >= STRONG for k in range(len(lines))])
    beside = beside_disparity(raw.surface, p, s)
    # A depth step is known to a pixel or two: the values farthest out on both sides.
    sides = np.stack([_first_known(beside[:, [0, 1]]), _first_known(beside[:, [4, 3]])])
    near, far = np.fmax(*sides), np.fmin(*sides)
    offset = raw.rig.left.cx - raw.rig.right.cx
    asked = strong[e] & np.isfinite(near) & (p[:, 0] - near - offset > 2.0)
    near, far = np.where(np.isfinite(near), near, 0.0), np.where(np.isfinite(far), far, 0.0)
    depth = raw.rig.left.fx * raw.rig.baseline / np.maximum(near, 1e-3)
    return {
        'point': raw.rig.left.rays(p) * depth[:, None],
        'direction': np.full((len(p), 3), np.nan),
        'pixel': p,
        'slope': s,
        'near': near,
        'far': far,
        'edge': -1 - e,
        'weight': w,
        'contrast': contrast,
        'flat': np.abs(s[:, 1]) < np.sin(np.radians(NEAR_ROWS_DEG)),
        'asked': asked,
    }


def _first_known(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values[:, 0]), values[:, 0], values[:, 1])


ACROSS = (-3.0, -1.5, 0.0, 1.5, 3.0)


def beside_disparity(surface: np.ndarray, pixel: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """(s, 5) float64: the surface's disparity at five places across a line, NaN where not known."""
    normal = np.column_stack([-slope[:, 1], slope[:, 0]])
    at = np.round(pixel[:, None] + np.array(ACROSS)[:, None] * normal[:, None]).astype(int)
    h, w = surface.shape
    inside = (at[..., 0] >= 0) & (at[..., 0] < w) & (at[..., 1] >= 0) & (at[..., 1] < h)
    values = surface[np.clip(at[..., 1], 0, h - 1), np.clip(at[..., 0], 0, w - 1)].astype(float)
    return np.where(inside, values, np.nan)


def line_segments(image: np.ndarray) -> np.ndarray:
    """(n, 4) float64: OpenCV's line segments; its fast detector where LSD is left out of that version."""
    if hasattr(cv2, 'createLineSegmentDetector'):
        lines = cv2.createLineSegmentDetector().detect(image)[0]
    elif hasattr(cv2, 'ximgproc'):
        lines = cv2.ximgproc.createFastLineDetector().detect(image)
    else:
        edges = cv2.Canny(cv2.GaussianBlur(image, (0, 0), 1.0), 20, 60)
        lines = cv2.HoughLinesP(edges, 1.0, np.pi / 360.0, 20, minLineLength=12, maxLineGap=2)
    return np.zeros((0, 4)) if lines is None else np.asarray(lines, float).reshape(-1, 4)
