"""Which known parts a pair of true_pairs.py shows, where each stands, and when a pose of one is as good as another.

Nothing of a pair is loaded twice: pictures and rig come from :func:`true_pairs.load_pair`; here are the poses.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pose_bounds import PoseBound
from third_eyes import third_eye
from true_pairs import FAMILIES, LEAST_CONTRAST, PHOTOREAL_KINDS, TruePair, load_pair, pair_names

from csg_renderer import Solid, SolidOutline, load_models, model_features, parse_scene, scene_names, scene_path
from model_matcher.closed_form.real_pair import SQUARE_M
from model_matcher.model.index import ModelIndex, index_model
from model_matcher.model.symmetry import symmetries
from msgs_py import FeatureKind, PinholeCamera, Pose, StereoRig

# An instance has to be found when both cameras see this share of the length of all its edges and curves; a part that
# nothing hides shows 0.38 to 0.66 of it (photoreal's single parts), so that this is half of one or more.
SEEN_SHARE = 0.3
# A part's roll is in the picture when something is that is no circle about its axis: an edge of so many pixels, an arc
# of this share of its circle.
LEAST_EDGE_PX, LEAST_ARC = 6.0, 0.1
# Metres and sine: features this near to an axis lie on it.
ON_AXIS = 1e-6
# The box of ../shared/real/teabox as published, mm, a corner at the origin.
TEA_BOX = 'UNITS MM;\ntea_box = BLOCK (165, 80, 68);\nDRAW tea_box;\n'
# The other pair's reference contradicts its own pictures by 0.9 px (test_real_images.py).
TEA_BOX_PAIRS = ('tea box 000',)
# Degrees and metres to which the poses in pictures of cameras are true, as the folders' own pages have it.
TRUST = {'openvgr': (0.1, 0.5e-3), 'visp_cube': (0.3, 1.5e-3), 'teabox': (0.5, 1e-3)}
# Parts that are each other but for a detail.
ALIKE = {'w9': 'w9c', 'w9c': 'w9', 'w2': 'w3', 'w3': 'w2'}


@dataclass(frozen=True, eq=False)
class Part:
    """A known part: its solid, its index for the matcher, and what its symmetry makes equal.

    motions : model_T_model that lay the part on itself, the identity first
    axis : (2, 3) float64, a point and the unit direction of the axis about which any turn does; None without one
    """

    name: str
    solid: Solid
    index: ModelIndex
    motions: tuple[Pose, ...]
    axis: np.ndarray | None

    @property
    def middle(self) -> np.ndarray:
        """(3,) metres, the middle of the part: where its place is judged."""
        return np.asarray(self.index.middle)


@dataclass(frozen=True, eq=False)
class Instance:
    """A part in a pair. pose : left_T_part; share : of its features' length that both eyes see; axis : as that of the
    part, of what this picture shows of it: where bolt holes and keyway are hidden the roll is not in it; trust :
    degrees and metres, root mean square, by which the pose may itself be off."""

    part: Part
    pose: Pose
    share: float
    axis: np.ndarray | None
    trust: tuple[float, float] = (0.0, 0.0)

    @property
    def to_find(self) -> bool:
        return self.share >= SEEN_SHARE

    @property
    def place(self) -> np.ndarray:
        """(3,) metres, left optical frame."""
        return np.asarray(self.pose.apply(self.part.middle))

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6) of the pose itself, by ``pose_rows.step_between``: what turns it turns it about its middle."""
        moved, x, y, z = np.eye(6), *(self.pose.translation - self.place)
        moved[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        sigma = np.repeat([self.trust[1], np.radians(self.trust[0])], 3) / np.sqrt(3.0)
        return np.asarray(moved * sigma**2 @ moved.T)


@dataclass(frozen=True, eq=False)
class Pictures:
    """A rectified pair, (h, w) uint8 each, and its rig, metres."""

    name: str
    family: str
    left: np.ndarray
    right: np.ndarray
    rig: StereoRig


@dataclass(frozen=True, eq=False)
class PosedPair:
    """A pair, the instances in it, and the parts to ask for: those present, then those that are not there.

    bounds : by instance the least error that a pose can have, where that is known
    """

    pair: Pictures
    instances: tuple[Instance, ...]
    asked: tuple[Part, ...]
    bounds: tuple[PoseBound, ...] = ()


@dataclass(frozen=True)
class Difference:
    """How far a pose is from a true one: degrees, metres at the part's middle, and the latter's share of depth."""

    degrees: float
    metres: float
    depth_share: float

    def within(self, degrees: float, metres: float) -> bool:
        return self.degrees <= degrees and self.metres <= metres


def difference(instance: Instance, pose: Pose) -> Difference:
    """Of the nearest pose that symmetry makes as true."""
    true = nearest_true(instance, pose)
    place, found = true.apply(instance.part.middle), pose.apply(instance.part.middle)
    off = float(np.linalg.norm(place - found))
    return Difference(true.error_to(pose).rotation_deg, off, float(abs(found[2] - place[2]) / place[2]))


def nearest_true(instance: Instance, pose: Pose) -> Pose:
    """The pose that is as true as the instance's, by its symmetry and a free turn, and nearest in rotation."""
    true = [instance.pose.compose(motion) for motion in instance.part.motions]
    if instance.axis is not None:
        true = [_turned_to(one, pose, instance.axis) for one in true]
    return min(true, key=lambda one: one.error_to(pose).rotation)


def _turned_to(true: Pose, pose: Pose, axis: np.ndarray) -> Pose:
    """``true`` after the turn about an axis of the part that brings it nearest to ``pose``."""
    point, direction = axis
    left = true.rotation.T @ pose.rotation
    odd = np.array([left[2, 1] - left[1, 2], left[0, 2] - left[2, 0], left[1, 0] - left[0, 1]])
    # The trace of R(angle)^T left, which is greatest where the rotation left over is least.
    angle = np.arctan2(direction @ odd, np.trace(left) - direction @ left @ direction)
    turn = Pose.from_rotation_vector(angle * direction)
    return true.compose(Pose(turn.rotation, point - turn.rotate(point)))


def _nearest_on(axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    return np.asarray(axis[0] + ((point - axis[0]) @ axis[1]) * axis[1])


# -- parts -----------------------------------------------------------------------------------------------------


def make_part(name: str, solid: Solid) -> Part:
    """A part of a solid."""
    index = index_model(model_features(solid), name, SolidOutline(solid))
    axis = common_axis(index, np.arange(len(index.features)))
    motions = (Pose.identity(), *symmetries(index))
    if axis is not None:
        motions = (Pose.identity(), *_end_for_end(index, axis))
    return Part(name, solid, index, motions, axis)


def common_axis(index: ModelIndex, rows: np.ndarray) -> np.ndarray | None:
    """(2, 3) point and direction of the axis that all of some features turn about; None when there is none."""
    features = index.features.select(rows)
    round_ = features.kind != FeatureKind.EDGE
    curves = features.kind == FeatureKind.CURVE
    if len(features) == 0 or not round_.all() or not curves.any():
        return None
    if (np.abs(features.radii[curves, 0] - features.radii[curves, 1]) > ON_AXIS).any():
        return None
    direction, point = features.directions[0], features.start[0]
    away = np.linalg.norm(np.cross(features.start - point, direction), axis=1)
    turned = np.linalg.norm(np.cross(features.directions, direction), axis=1)
    if (away > ON_AXIS).any() or (turned > ON_AXIS).any():
        return None
    return np.stack([point, direction])


def _end_for_end(index: ModelIndex, axis: np.ndarray) -> list[Pose]:
    """The half turn across a part of circles about one axis, if it lays them on each other."""
    middle = _nearest_on(axis, index.middle)
    curves = index.features.of_kind(FeatureKind.CURVE)
    height, radius = (curves.start - middle) @ axis[1], curves.radii[:, 0]
    there = np.column_stack([height, radius])
    if (np.abs(there[:, None] * [-1.0, 1.0] - there).max(axis=2).min(axis=1) > ON_AXIS).any():
        return []
    across = np.cross(axis[1], np.eye(3)[np.argmin(np.abs(axis[1]))])
    turn = Pose.from_rotation_vector(np.pi * across / np.linalg.norm(across))
    return [Pose(turn.rotation, middle - turn.rotate(middle))]


@lru_cache(maxsize=64)
def part_in(path: Path) -> Part:
    """The part of a scene file."""
    return make_part(path.stem, next(iter(load_models(path).values())))


@lru_cache(maxsize=1)
def tea_box() -> Part:
    return make_part('tea_box', parse_scene(TEA_BOX).placements[0].model)


def all_parts(data: Path) -> list[Part]:
    """Every part there is a model of: those of the families, and the models of the scenes that csg_renderer brings."""
    files = [
        *sorted((data / 'real/openvgr/models').glob('*.csg')),
        *sorted((data / 'real/visp_cube').glob('*.csg')),
        *sorted((data / 'photoreal/parts').glob('*.csg')),
    ]
    parts = [tea_box(), *(part_in(path) for path in files)]
    for scene in scene_names():
        for name, solid in load_models(scene_path(scene)).items():
            if any(part.name == f'thesis {name}' for part in parts):
                continue
            try:
                parts.append(make_part(f'thesis {name}', solid))
            except ValueError:
                continue  # terrains and the like: nothing that a matcher could look for
    return parts


parts_of = lru_cache(maxsize=1)(all_parts)


# -- families --------------------------------------------------------------------------------------------------


def _photoreal(folder: Path, name: str) -> tuple[list[Instance], list[Part]]:
    truth = json.loads((folder / 'truth' / f'{name}.json').read_text())
    parts = {part: part_in(folder / 'parts' / f'{part}.csg') for part in (*truth['present'], *truth['absent'])}
    instances = []
    for number, given in enumerate(truth['instances']):
        part = parts[given['part']]
        seen = [
            e['feature']
            for e in truth['edges']
            if e['instance'] == number and e['pixels'] >= LEAST_EDGE_PX and e['contrast'] >= LEAST_CONTRAST
        ]
        seen += [
            c['feature']
            for c in truth['curves']
            if c['instance'] == number and c['fraction_visible'] >= LEAST_ARC and c['contrast'] >= LEAST_CONTRAST
        ]
        axis = part.axis
        if axis is None and seen:
            axis = common_axis(part.index, np.flatnonzero(np.isin(part.index.source, seen)))
        instances.append(Instance(part, _pose_of(given['left_T_part']), given['visible_share'], axis))
    return instances, list(parts.values())


def _openvgr(folder: Path, name: str) -> tuple[list[Instance], list[Part]]:
    truth = json.loads((folder / f'{name}.json').read_text())
    parts = {path.stem: part_in(path) for path in sorted((folder / 'models').glob('*.csg'))}
    instances = []
    for given in truth['instances']:
        part = parts[given['part']]
        # 1 is all that could be seen, not all there is.
        pose = rigid_pose(given['R'], given['t'])
        instances.append(Instance(part, pose, given['visible_share'], part.axis, TRUST['openvgr']))
    present = [one.part.name for one in instances]
    return instances, [parts[part] for part in (*present, *(other for other in parts if other not in present))]


def _cube(folder: Path, name: str) -> tuple[list[Instance], list[Part]]:
    truth = next(t for t in json.loads((folder / 'truth.json').read_text()) if t['name'] == name)
    part = part_in(folder.parent / 'cube.csg')
    return [Instance(part, rigid_pose(truth['cube']['R'], truth['cube']['t']), 1.0, None, TRUST['visp_cube'])], [part]


def _teabox(folder: Path, name: str) -> tuple[list[Instance], list[Part]]:
    reference = json.loads((folder / 'box_poses.json').read_text())
    entry = reference['poses'][name.split()[-1]]
    pose = Pose.from_rotation_vector(entry['rvec'], entry['tvec_m'])
    return [Instance(tea_box(), pose, 1.0, None, TRUST['teabox'])], [tea_box()]


def _pose_of(matrix: Any) -> Pose:
    matrix = np.array(matrix, float)
    return rigid_pose(matrix[:3, :3], matrix[:3, 3])


def rigid_pose(rotation: Any, translation: Any) -> Pose:
    """R and t of a file, with as many digits as a rotation must have."""
    u, _, v = np.linalg.svd(np.array(rotation, float))
    return Pose(u @ v, np.array(translation, float))


READERS: dict[str, Callable[[Path, str], tuple[list[Instance], list[Part]]]] = {
    'openvgr': _openvgr,
    'teabox': _teabox,
    'visp_cube': _cube,
    **dict.fromkeys(PHOTOREAL_KINDS, _photoreal),
}


def posed_pair(data: Path, pair: TruePair) -> PosedPair:
    """A pair with what stands where in it; nothing for families without known parts."""
    pictures = Pictures(pair.name, pair.family, pair.left, pair.right, _in_metres(pair))
    if pair.family not in READERS:
        return PosedPair(pictures, (), ())
    instances, asked = READERS[pair.family](data / FAMILIES[pair.family].folder, pair.name)
    return PosedPair(pictures, tuple(instances), tuple(dict.fromkeys(asked)))


def posed_pairs(
    data: Path, families: list[str], scenes: list[str] | None = None, held: bool = False
) -> Iterator[PosedPair]:
    """Pairs of families one after the other, those whose truth is doubted left out."""
    for family, name in posed_names(data, families, scenes, held):
        yield posed_pair(data, load_pair(data, family, name))


def posed_names(
    data: Path, families: list[str], scenes: list[str] | None = None, held: bool = False
) -> list[tuple[str, str]]:
    """Family and name of each of :func:`posed_pairs`; scenes: those whose name begins with one of these."""
    return [
        (family, name)
        for family in families
        for name in pair_names(data, family, held)
        if (not scenes or any(name.startswith(scene) for scene in scenes))
        and (family != 'teabox' or name in TEA_BOX_PAIRS)
    ]


def _in_metres(pair: TruePair) -> StereoRig:
    """The rig of a pair with its baseline in metres; that of the chessboards is given in squares."""
    if pair.family != 'chessboards':
        return pair.rig
    return StereoRig(pair.rig.left, pair.rig.right, pair.rig.baseline * SQUARE_M)


def witness(data: Path, pair: Pictures) -> tuple[np.ndarray, PinholeCamera, Pose] | None:
    """Picture, camera and left_T_camera of an eye that the pair does not contain; None when there is none."""
    return third_eye(data, pair) if pair.family == 'openvgr' else None
