"""Known parts seen by three tenths of their features, among four times as many features of other things.

The pictures are rendered. A screen stands before each part, from a side and at an angle that chance chose, and is
pushed in until both eyes see three tenths of the length of all the part's features; beside and behind are blocks,
notched blocks and cylinders, until of all visible features four in five are theirs.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from true_poses import Instance, Part, Pictures, PosedPair, make_part

from csg_renderer import Placement, Scene, Solid, Surface, load_models, parse_scene, render_stereo, scene_path
from csg_renderer.raycast.sensor import SensorModel
from csg_renderer.visibility.hidden_lines import stereo_fragments
from model_matcher.closed_form.case import Case
from model_matcher.closed_form.placement import lights_about
from model_matcher.closed_form.scene_files import clutter_about
from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose, StereoRig

HIDDEN = 'hidden'
MODELS = ('l_shape', 'wedge', 'chipped_block', 'chair', 'computer', 'plug')
VISIBLE, CLUTTER, MOST_CLUTTER = 0.3, 0.8, 100
# The cameras, and the share of a picture's height across a part.
CAMERA = PinholeCamera.centred(640, 480, 600.0)
SPAN, BASELINE_SHARE = 0.6, 0.15
ANTIALIAS = 3
SCREEN, BACKGROUND = (0.5, 0.5, 0.6), (0.35, 0.35, 0.35)


@lru_cache(maxsize=len(MODELS))
def _part(name: str) -> Part:
    return make_part(name, next(iter(load_models(scene_path(name)).values())))


def hidden_names(seeds: int) -> list[str]:
    """Of so many scenes of every model."""
    return [f'{model} {seed}' for model in MODELS for seed in range(seeds)]


def hidden_pair(name: str) -> PosedPair:
    """A scene of :func:`hidden_names`; asked for are its part and all others, which are not there."""
    model, seed = name.rsplit(' ', 1)
    rng = np.random.default_rng([MODELS.index(model), int(seed), 30])
    part = _part(model)
    radius = 0.5 * float(np.linalg.norm(np.ptp(part.index.features.start, axis=0)))
    depth = CAMERA.fx * 2.0 * radius / (SPAN * CAMERA.height)
    rig = StereoRig.symmetric(CAMERA, BASELINE_SHARE * depth)
    while True:
        pose = _random_pose(rng, part, depth)
        screen = _screen(part, pose, rig, radius, float(rng.uniform(0.0, 2.0 * np.pi)))
        if screen is not None:
            break
    placed = [(part.solid, pose), screen]
    clutter = clutter_about(rng, [(pose.apply(part.middle), 2.0 * radius)], CAMERA, MOST_CLUTTER, 2.0 * radius)
    for text, place in clutter:
        if _clutter_share(placed, rig) >= CLUTTER:
            break
        placed.append((parse_scene(f'UNITS M;\nDRAW {text} PAINT FACES;').placements[0].solid, place))
    scene = Scene(
        [Placement(f'solid{k}', solid, place.matrix) for k, (solid, place) in enumerate(placed)],
        lights_about(depth),
        background=BACKGROUND,
    )
    left, right = (
        SensorModel(Case.psf, Case.noise, (int(seed), MODELS.index(model), eye)).picture(frame, monochrome=True)
        for eye, frame in enumerate(render_stereo(scene, rig, antialias=ANTIALIAS, psf=Case.psf))
    )
    share = _share(part, stereo_fragments(placed, rig)[0][0])
    others = tuple(_part(other) for other in MODELS if other != model)
    return PosedPair(
        Pictures(name, HIDDEN, left, right, rig), (Instance(part, pose, share, part.axis),), (part, *others)
    )


def _random_pose(rng: np.random.Generator, part: Part, depth: float) -> Pose:
    """left_T_part, turned at random, the part's middle within a tenth of the depth of the middle of the picture."""
    turn = Rotation.random(random_state=rng).as_matrix()
    place = depth * np.array([*rng.uniform(-0.1, 0.1, 2), 1.0])
    return Pose(turn, place - turn @ part.middle)


def _screen(part: Part, pose: Pose, rig: StereoRig, radius: float, angle: float) -> tuple[Solid, Pose] | None:
    """A screen before a part that leaves VISIBLE of it, its edge at an angle; None where less is seen without one."""
    thick, wide = 0.1 * radius, 12.0 * radius
    plate = Solid.block(wide, wide, thick).painted(Surface(SCREEN))
    middle = pose.apply(part.middle)
    near = middle[2] - 1.5 * radius
    turn = Rotation.from_euler('z', angle).as_matrix()

    def placed(edge: float) -> tuple[Solid, Pose]:
        """Its edge so far beyond the part's middle, metres at the part's depth."""
        through = middle * near / middle[2]
        corner = through + turn @ np.array([edge * near / middle[2], -0.5 * wide, 0.0])
        return plate, Pose(turn, corner)

    def seen(edge: float) -> float:
        return _share(part, stereo_fragments([(part.solid, pose), placed(edge)], rig)[0][0]) - (VISIBLE + 1e-3)

    if seen(2.0 * radius) < 0.0:
        return None
    return placed(float(brentq(seen, -2.0 * radius, 2.0 * radius, xtol=1e-3 * radius)))


def _share(part: Part, seen: FeatureSet) -> float:
    """Of the length of all a part's features."""
    return float(_length(seen) / _length(part.index.features))


def _length(features: FeatureSet) -> float:
    lines = [features.polyline(int(k), 65) for k in np.flatnonzero(features.kind != FeatureKind.AXIS)]
    return float(sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines))


def _clutter_share(placed: list[tuple[Solid, Pose]], rig: StereoRig) -> float:
    """Of the number of features that both eyes see."""
    counts = [len(features) for features, _ in stereo_fragments(placed, rig)]
    return 1.0 - counts[0] / max(sum(counts), 1)
