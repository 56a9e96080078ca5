"""A scene: placed solids, lights, and the light that comes from everywhere."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from msgs_py import PinholeCamera, Pose

from .settings import DEFAULT_AMBIENT, DEFAULT_BACKGROUND
from .solid import Primitive, Solid, as_matrix, colour
from .textures import Environment


@dataclass(frozen=True)
class Light:
    """A light: a point, or a ball that shines alike in all directions.

    Its light does not fall off with the distance. That of a ball is the mean over what of it a place sees.

    Parameters
    ----------
    position : (3,) array_like of float64
        Metres, scene frame.
    colour : (3,) array_like of float64
        Red, green, blue in 0..1, linear.
    radius : float
        Metres; 0 is a point. The shadows of a ball (option ``shadows``) are soft.

    Raises
    ------
    ValueError
        An argument is out of its range; the message begins with its name.
    """

    position: tuple[float, float, float]
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    radius: float = 0.0

    def __post_init__(self) -> None:
        position = np.asarray(self.position, dtype=np.float64)
        if position.shape != (3,) or not np.isfinite(position).all():
            raise ValueError(f'position: expected three finite numbers, got {self.position}')
        object.__setattr__(self, 'position', tuple(float(x) for x in position))
        object.__setattr__(self, 'colour', colour(self.colour, 'colour'))
        if not 0.0 <= self.radius < np.inf:
            raise ValueError(f'radius: expected a number >= 0, got {self.radius:g}')
        object.__setattr__(self, 'radius', float(self.radius))


@dataclass(frozen=True, eq=False)
class Placement:
    """A drawn object: which model, and where. One DRAW statement makes one.

    Parameters
    ----------
    name : str
        Of the object.
    model : Solid
        In its own frame, metres.
    matrix : (4, 4) array_like of float64
        Column form, scene from model, any affine map.
    frames : dict of str to Pose
        Named frames on it (FRAME), model_T_frame, metres: where to grip it, say.
    """

    name: str
    model: Solid
    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))
    frames: dict[str, Pose] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'matrix', np.array(as_matrix(self.matrix)))

    @property
    def solid(self) -> Solid:
        """The model in the scene frame."""
        return self.model.transformed(self.matrix)

    @property
    def pose(self) -> Pose:
        """The pose scene_T_model.

        Raises
        ------
        ValueError
            The placement is no rotation, translation and uniform scale.
        """
        return Pose.from_matrix(self.matrix)


class Scene:
    """What is rendered.

    Parameters
    ----------
    solids : Solid, Placement, or iterable of them
        Placements where model and pose matter; Frame.object_id counts them in this order.
    lights : iterable of Light
    ambient_light, background : (3,) array_like of float64
        Light from everywhere, and the colour where there is nothing, 0..1, linear.
    definitions : dict of str to Solid, optional
        Named solids of the scene file, model frame, metres.
    camera : PinholeCamera, optional
        What the file says of the camera (CAMERA).
    camera_T_scene : Pose, optional
        Where it stands; the identity by default.
    baseline : float, optional
        What the file says of the second camera (STEREO, DISPARITY), metres.
    environment : Environment, optional
        What surrounds it; it takes the place of ``ambient_light`` and ``background``.

    Examples
    --------
    >>> scene = Scene(Solid.sphere(0.1).transformed(Pose(np.eye(3), [0, 0, 1])), [Light((0, -1, 0))])
    >>> scene
    Scene(object0; 1 primitives, 1 lights)
    """

    def __init__(
        self,
        solids: Iterable[Solid | Placement] | Solid | Placement,
        lights: Iterable[Light] = (),
        ambient_light: ArrayLike = DEFAULT_AMBIENT,
        background: ArrayLike = DEFAULT_BACKGROUND,
        *,
        definitions: dict[str, Solid] | None = None,
        camera: PinholeCamera | None = None,
        camera_T_scene: Pose | None = None,
        baseline: float | None = None,
        environment: Environment | None = None,
    ) -> None:
        if isinstance(solids, Solid | Placement):
            solids = [solids]
        self.placements: tuple[Placement, ...] = tuple(
            item if isinstance(item, Placement) else Placement(f'object{index}', item)
            for index, item in enumerate(solids)
        )
        self.solids: tuple[Solid, ...] = tuple(placement.solid for placement in self.placements)
        self.lights: tuple[Light, ...] = tuple(lights)
        self.ambient_light = colour(ambient_light, 'ambient_light')
        self.background = colour(background, 'background')
        self.definitions: dict[str, Solid] = dict(definitions or {})
        self.camera = camera
        self.camera_T_scene = camera_T_scene if camera_T_scene is not None else Pose()
        self.baseline = baseline
        self.environment = environment

    @property
    def primitives(self) -> tuple[Primitive, ...]:
        """All leaves, object by object, left to right; Frame.primitive_id indexes it."""
        return tuple(leaf for solid in self.solids for leaf in solid.primitives)

    def __repr__(self) -> str:
        names = ', '.join(placement.name for placement in self.placements)
        return f'Scene({names or "empty"}; {len(self.primitives)} primitives, {len(self.lights)} lights)'
