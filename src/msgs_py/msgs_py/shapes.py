"""What space an object takes, in the shapes that planners know."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from .numeric.typed import FloatArray, IntArray
from .pose import Pose

Kind = Literal['BOX', 'SPHERE', 'CYLINDER', 'CONE']


@dataclass(frozen=True, eq=False)
class PrimitiveShape:
    """A primitive as shape_msgs/SolidPrimitive has it: the middle of its bounding box is the origin.

    Attributes
    ----------
    kind : str
        BOX, SPHERE, CYLINDER (along z) or CONE (its tip on +z).
    dimensions : tuple of float
        Metres: x, y, z of a box; radius of a sphere; height and radius of a cylinder or cone.
    pose : Pose
        model_T_shape.
    """

    kind: Kind
    dimensions: tuple[float, ...]
    pose: Pose


@dataclass(frozen=True, eq=False)
class MeshShape:
    """Triangles.

    Attributes
    ----------
    vertices : (n, 3) float64
        Metres, model frame.
    triangles : (m, 3) int
        Vertices of each, anticlockwise seen from outside.
    """

    vertices: FloatArray
    triangles: IntArray


@dataclass(frozen=True, eq=False)
class CollisionShapes:
    """The space that an object takes: the union of shapes.

    Attributes
    ----------
    primitives : tuple of PrimitiveShape
    meshes : tuple of MeshShape
    note : str, optional
        How they differ from the object; None when they are the object itself, but for facets of curved faces.
    """

    primitives: tuple[PrimitiveShape, ...]
    meshes: tuple[MeshShape, ...] = field(default=())
    note: str | None = None
