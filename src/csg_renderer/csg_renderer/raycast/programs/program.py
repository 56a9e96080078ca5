"""A scene made ready for the engines: flat arrays instead of trees.

Scenes are rendered many times (two cameras, many poses), so what does not depend on the camera is worked out once here.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from msgs_py import Pose
from msgs_py.numeric.typed import FloatArray

from ...scene.scene import Scene
from ...scene.solid import Operation, Primitive, Solid
from ...scene.terrain import Terrain
from ..settings import COINCIDENT, DEPARTURE
from .surface_data import SurfaceData, surface_data

# Codes of a postfix program; a number >= 0 is a leaf index.
UNION, INTERSECT, DIFFERENCE = -1, -2, -3
# A DIFFERENCE whose operands are on the stack the other way round (tree_order.py).
REVERSED_DIFFERENCE = -4
OPERATOR_CODES = {'UNION': UNION, 'INTERSECT': INTERSECT, 'DIFFERENCE': DIFFERENCE}

BLOCK, CYLINDER, CONE, SPHERE, PLANE, TERRAIN = range(6)
KIND_CODES = {'BLOCK': BLOCK, 'CYLINDER': CYLINDER, 'CONE': CONE, 'SPHERE': SPHERE, 'PLANE': PLANE, 'TERRAIN': TERRAIN}
HALFSPACES = np.array([6, 3, 2, 1, 1, 1])

# Convex outlines of the primitives in their unit frames; the projection of the hull holds that of the primitive.
_BOX = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


def _octagon() -> np.ndarray:
    """(8, 2): the regular octagon about the unit circle."""
    angle = (np.arange(8) + 0.5) * (np.pi / 4)
    octagon: FloatArray = np.stack([np.cos(angle), np.sin(angle)], axis=1) / np.cos(np.pi / 8)
    return octagon


def _outlines() -> dict[int, np.ndarray]:
    ring = _octagon()
    low, high = np.zeros((8, 1)), np.ones((8, 1))
    base = np.hstack([ring, high])
    # A cube's corners cut off: |x|, |y|, |z| <= 1 and |x| + |y| + |z| <= sqrt(3) touches the unit sphere everywhere.
    cut = np.sqrt(3.0) - 1.0
    sphere = np.array(
        [
            p
            for x in (-1.0, 1.0)
            for y in (-1.0, 1.0)
            for p in (
                [x, y * cut, 0.0],
                [x * cut, y, 0.0],
                [x, 0.0, y * cut],
                [x * cut, 0.0, y],
                [0.0, x, y * cut],
                [0.0, x * cut, y],
            )
        ]
    )
    return {
        BLOCK: _BOX,
        CYLINDER: np.vstack([np.hstack([ring, low]), base]),
        CONE: np.vstack([np.zeros((1, 3)), base]),
        SPHERE: sphere,
        PLANE: np.zeros((0, 3)),
    }


OUTLINES = _outlines()


@dataclass(frozen=True, eq=False)
class Program:
    """A scene in flat arrays. n leaves, c children, l lights.

    Attributes
    ----------
    leaves : tuple of Primitive
    kind : (n,) int64
        See KIND_CODES.
    inverse : (n, 4, 4) float64
        Unit frame of each leaf from the scene.
    object_of : (n,) int64
        Index into Scene.solids.
    colours : (n, 6, 3) float64
        Of each face, linear.
    material : (n, 6) float64
        Ambient, diffuse, specular, shininess, reflection, transparency.
    children : tuple of (m,) int64
        Postfix programs, one for every operand of the unions at the top of the objects. The nearest entry of any child
        is what a ray sees.
    terrains : tuple of int
        The leaves that are height grids, and in no child.
    outline : (p, 3) float64
        Corners of convex hulls of the leaves, metres, scene frame.
    outline_start : (n + 1,) int64
        The corners of each leaf.
    extent : float
        How far from the origin the bounded leaves reach, metres.
    lights, light_colours : (l, 3) float64
        Positions in metres, scene frame, and colours.
    ambient_light, background : (3,) float64
    surfaces : SurfaceData or None
        Pictures, metals, sizes of lights and surroundings.
    """

    leaves: tuple[Primitive, ...]
    kind: np.ndarray
    inverse: np.ndarray
    object_of: np.ndarray
    colours: np.ndarray
    material: np.ndarray
    children: tuple[np.ndarray, ...]
    terrains: tuple[int, ...]
    outline: np.ndarray
    outline_start: np.ndarray
    extent: float
    lights: np.ndarray
    light_colours: np.ndarray
    ambient_light: np.ndarray
    background: np.ndarray
    surfaces: SurfaceData | None


@dataclass(frozen=True, eq=False)
class View:
    """A program seen by a camera.

    Attributes
    ----------
    program : Program
    scene_T_camera : (4, 4) float64
    local : (n, 3, 4) float64
        Unit frame of each leaf from the camera: a ray (x, y, 1) has the local direction
        ``local[:, 0] x + local[:, 1] y + local[:, 2]`` and the local origin ``local[:, 3]``.
    tolerance : float
        Surfaces this close along a ray are one, metres.
    departure : float
        Secondary rays ignore what is nearer than this, metres.
    """

    program: Program
    scene_T_camera: np.ndarray
    local: np.ndarray
    tolerance: float
    departure: float


_programs: WeakKeyDictionary[Scene, Program] = WeakKeyDictionary()


def program_of(scene: Scene) -> Program:
    """The program of a scene, made on first use and kept as long as the scene lives.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Program
    """
    program = _programs.get(scene)
    if program is None:
        program = _programs[scene] = _compile(scene)
    return program


def view_of(program: Program, camera_T_scene: Pose) -> View:
    """A program as a camera sees it.

    Parameters
    ----------
    program : Program
    camera_T_scene : Pose

    Returns
    -------
    View
    """
    scene_T_camera = camera_T_scene.inverse().matrix
    local = program.inverse @ scene_T_camera
    reach = program.extent + float(np.linalg.norm(scene_T_camera[:3, 3]))
    return View(program, scene_T_camera, np.ascontiguousarray(local[:, :3]), COINCIDENT * reach, DEPARTURE * reach)


def top_level(solid: Solid) -> list[Solid]:
    """The operands of the unions at the top of a tree.

    Parameters
    ----------
    solid : Solid

    Returns
    -------
    list of Solid
        Left to right.

    Examples
    --------
    >>> from csg_renderer import Solid
    >>> ball = Solid.sphere(1.0)
    >>> len(top_level(ball | (ball - ball) | ball))
    3
    """
    found: list[Solid] = []
    pending = [solid]
    while pending:
        node = pending.pop()
        if isinstance(node, Operation) and node.operator == 'UNION':
            pending += [node.right, node.left]
        elif node.primitives:
            found.append(node)
    return found


def postfix(solid: Solid, first_leaf: int) -> np.ndarray:
    """A tree in reverse Polish order (thesis 4.8).

    Parameters
    ----------
    solid : Solid
    first_leaf : int
        Number of its first leaf.

    Returns
    -------
    (m,) int64
        Numbers of leaves, and UNION, INTERSECT or DIFFERENCE.

    Examples
    --------
    >>> from csg_renderer import Solid
    >>> ball = Solid.sphere(1.0)
    >>> postfix(ball | (ball - ball), 4).tolist()
    [4, 5, 6, -3, -1]
    """
    code: list[int] = []
    leaf = first_leaf
    pending: list[Solid | int] = [solid]
    while pending:
        node = pending.pop()
        if isinstance(node, int):
            code.append(node)
        elif isinstance(node, Operation):
            pending += [OPERATOR_CODES[node.operator], node.right, node.left]
        elif isinstance(node, Terrain):
            raise ValueError('terrain: a sheet takes no part in INTERSECT or DIFFERENCE; draw it as an object')
        else:
            code.append(leaf)
            leaf += 1
    return np.array(code, dtype=np.int64)


def _compile(scene: Scene) -> Program:
    leaves = scene.primitives
    n = len(leaves)
    children: list[np.ndarray] = []
    terrains: list[int] = []
    first = 0
    for solid in scene.solids:
        for child in top_level(solid):
            if isinstance(child, Terrain):
                terrains.append(first)
            else:
                children.append(postfix(child, first))
            first += len(child.primitives)
    object_of = np.repeat(np.arange(len(scene.solids)), [len(solid.primitives) for solid in scene.solids])
    colours = np.zeros((n, 6, 3))
    material = np.zeros((n, 6))
    outlines = []
    for index, leaf in enumerate(leaves):
        surface = leaf.surface
        colours[index] = surface.colour
        if leaf.face_colours is not None:
            colours[index, : len(leaf.face_colours)] = leaf.face_colours
        material[index] = (
            surface.ambient,
            surface.diffuse,
            surface.specular,
            surface.shininess,
            surface.reflection,
            surface.transparency,
        )
        points = leaf.outline if isinstance(leaf, Terrain) else OUTLINES[KIND_CODES[leaf.kind]]
        outlines.append(points @ leaf.matrix[:3, :3].T + leaf.matrix[:3, 3])
    outline = np.concatenate(outlines) if outlines else np.zeros((0, 3))
    anchors = np.array([leaf.matrix[:3, 3] for leaf in leaves]).reshape(-1, 3)
    extent = max(
        [float(np.linalg.norm(points, axis=1).max()) for points in (outline, anchors) if len(points)], default=0.0
    )
    return Program(
        leaves,
        np.array([KIND_CODES[leaf.kind] for leaf in leaves], dtype=np.int64),
        np.linalg.inv(np.array([leaf.matrix for leaf in leaves])) if n else np.zeros((0, 4, 4)),
        object_of.astype(np.int64),
        colours,
        material,
        tuple(children),
        tuple(terrains),
        outline,
        np.concatenate([[0], np.cumsum([len(points) for points in outlines])]).astype(np.int64),
        extent,
        np.array([light.position for light in scene.lights]).reshape(-1, 3),
        np.array([light.colour for light in scene.lights]).reshape(-1, 3),
        np.array(scene.ambient_light),
        np.array(scene.background),
        surface_data(scene, leaves),
    )
