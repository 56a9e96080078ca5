"""The part of a plan: its solid, what the matcher knows of it, what its symmetry makes equal, and how it is lit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from csg_renderer import Light, Scene, Solid, SolidOutline, load_scene, model_features, parse_scene
from csg_renderer.language import find_scene
from csg_renderer.raycast.render import render
from csg_renderer.raycast.sensor import grey
from msgs_py import Pose
from msgs_py.numeric.typed import FloatArray

from ...model.index import ModelIndex, index_model
from ...model.symmetry import Axis, axis_of_revolution, symmetries
from ..placement import lights_about
from ..scene_files import clutter_lines
from .rig import PlannedRig


@dataclass(frozen=True, eq=False)
class PlannedPart:
    """A part.

    Parameters
    ----------
    name : str
    solid : Solid
        Model frame, metres.
    index : ModelIndex
        For the matcher.
    scene : Scene
        That it was read from: its light and its background are those of the plan.
    """

    name: str
    solid: Solid
    index: ModelIndex
    scene: Scene

    @cached_property
    def ball(self) -> tuple[FloatArray, float]:
        """Middle (3,) float64, metres, model frame, and radius of a sphere about it."""
        features = self.index.features
        points = np.concatenate([features.polyline(k, 16) for k in range(len(features))])
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        return middle, float(np.linalg.norm(points - middle, axis=1).max())

    @cached_property
    def motions(self) -> tuple[Pose, ...]:
        """model_T_model that lay the part on itself, the identity first; turns about an axis of revolution left out."""
        return (Pose.identity(), *symmetries(self.index))

    @cached_property
    def axis(self) -> Axis | None:
        """The axis about which it is the same all round."""
        return axis_of_revolution(self.index)

    def pictures(
        self, poses: Sequence[Pose], rig: PlannedRig, antialias: int, clutter: Sequence[tuple[str, Pose]] = ()
    ) -> list[FloatArray]:
        """What cameras see whose chips are perfect.

        Parameters
        ----------
        poses : sequence of Pose
            left_T_part of every part in the picture.
        rig : PlannedRig
        antialias : int
            Samples along each side of a pixel; 0 for one in its middle, before a lens that is perfect, too.
        clutter : sequence of (str, Pose)
            Of :func:`~model_matcher.closed_form.scene_files.clutter_about`.

        Returns
        -------
        list of (h, w) float64
            Grey levels 0..255 of each camera, without noise.
        """
        others = [] if not clutter else parse_scene('\n'.join(['UNITS M;', *clutter_lines(clutter)])).placements
        solids = [self.solid.transformed(pose) for pose in poses] + [one.solid for one in others]
        depths = [float(pose.apply(self.ball[0])[2]) for pose in poses] or [one.matrix[2, 3] for one in others]
        lights = _lights(self.scene, float(np.median(depths)) if depths else 1.0)
        scene = Scene(solids, lights, self.scene.ambient_light, self.scene.background)
        cameras, psf = rig.cameras, rig.sensor.psf if antialias else 0.0
        return [
            grey(render(scene, camera, pose.inverse(), antialias=antialias, psf=psf).image)
            for camera, pose in zip(cameras.cameras, cameras.poses)
        ]


def load_part(path: str) -> PlannedPart:
    """The part that a scene file draws first.

    Parameters
    ----------
    path : str
        A scene file, or the name of one that comes with csg_renderer.

    Raises
    ------
    OSError
        There is no such file.
    ValueError
        It cannot be used; the message begins with its name.
    """
    scene = load_scene(find_scene(path))
    if not scene.placements:
        raise ValueError(f'{path}: draws nothing')
    first = scene.placements[0]
    name = first.name if first.name in scene.definitions else Path(path).stem
    try:
        index = index_model(model_features(first.model), name, SolidOutline(first.model))
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None
    return PlannedPart(name, first.model, index, scene)


def _lights(scene: Scene, depth: float) -> list[Light]:
    """A scene's lights in the camera's frame, else two about an object at a depth, metres."""
    if scene.lights or scene.ambient_light != Scene([]).ambient_light:
        return [Light(tuple(scene.camera_T_scene.apply(np.asarray(one.position))), one.colour) for one in scene.lights]
    return list(lights_about(depth))
