"""The space that objects take: moveit_msgs/CollisionObject for those who have it, markers for the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
from geometry_msgs.msg import Point
from geometry_msgs.msg import Pose as PoseMessage
from shape_msgs.msg import Mesh, MeshTriangle, SolidPrimitive
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ..numeric.typed import FloatArray
from ..pose import Pose
from ..shapes import CollisionShapes, PrimitiveShape
from .poses import pose_to_message

# Facets of a cone that is drawn, for which markers have no type.
CONE_FACETS = 24
# Red, green, blue and opacity of objects that are drawn.
COLOUR = (0.9, 0.6, 0.2, 0.5)


@dataclass(frozen=True, eq=False)
class SceneObject:
    """An object in a planner's scene.

    Attributes
    ----------
    name, model : str
        Which one it is, and what.
    pose : Pose
        header's frame_T_model.
    shapes : CollisionShapes
    frames : mapping of str to Pose
        Named frames on it, model_T_frame.
    """

    name: str
    model: str
    pose: Pose
    shapes: CollisionShapes
    frames: Mapping[str, Pose] = field(default_factory=dict)


def collision_messages() -> Any | None:
    """The module moveit_msgs.msg, or None where it is not installed (it does not come with the wheels)."""
    try:
        return import_module('moveit_msgs.msg')
    except ImportError:
        return None


def shapes_to_messages(
    shapes: CollisionShapes, scale: float = 1.0
) -> tuple[list[SolidPrimitive], list[PoseMessage], list[Mesh], list[PoseMessage]]:
    """The messages of shapes.

    Parameters
    ----------
    shapes : CollisionShapes
    scale : float
        What their sizes are multiplied by.

    Returns
    -------
    primitives, primitive_poses : list of shape_msgs.msg.SolidPrimitive and of geometry_msgs.msg.Pose
    meshes, mesh_poses : list of shape_msgs.msg.Mesh and of geometry_msgs.msg.Pose
    """
    primitives = [
        SolidPrimitive(type=getattr(SolidPrimitive, one.kind), dimensions=[scale * x for x in one.dimensions])
        for one in shapes.primitives
    ]
    meshes = [
        Mesh(
            triangles=[MeshTriangle(vertex_indices=np.asarray(face, np.uint32)) for face in one.triangles],
            vertices=[Point(x=x, y=y, z=z) for x, y, z in (scale * one.vertices).tolist()],
        )
        for one in shapes.meshes
    ]
    poses = [pose_to_message(_scaled(one.pose, scale)) for one in shapes.primitives]
    return primitives, poses, meshes, [pose_to_message(Pose.identity()) for _ in meshes]


def collision_object(one: SceneObject, header: Header, messages: Any) -> Any:
    """The moveit_msgs/CollisionObject that puts an object into the scene, or at its new pose.

    Parameters
    ----------
    one : SceneObject
    header : std_msgs.msg.Header
    messages : module
        :func:`collision_messages`.
    """
    made = removal(one.name, header, messages)
    made.operation = messages.CollisionObject.ADD
    made.type.key = one.model
    made.pose = pose_to_message(one.pose)
    scale = one.pose.scale
    made.primitives, made.primitive_poses, made.meshes, made.mesh_poses = shapes_to_messages(one.shapes, scale)
    made.subframe_names = list(one.frames)
    made.subframe_poses = [pose_to_message(_scaled(frame, scale)) for frame in one.frames.values()]
    return made


def removal(name: str, header: Header, messages: Any) -> Any:
    """The moveit_msgs/CollisionObject that takes the object of a name out of the scene.

    Parameters
    ----------
    name : str
    header : std_msgs.msg.Header
    messages : module
        :func:`collision_messages`.
    """
    return messages.CollisionObject(header=header, id=name, operation=messages.CollisionObject.REMOVE)


def objects_to_markers(objects: Sequence[SceneObject], header: Header) -> MarkerArray:
    """Objects for a viewer: a marker for each shape, its namespace the object's name; begins by deleting the last ones.

    Parameters
    ----------
    objects : sequence of SceneObject
    header : std_msgs.msg.Header
    """
    array = MarkerArray(markers=[Marker(header=header, action=Marker.DELETEALL)])
    for one in objects:
        scale = one.pose.scale
        for shape in one.shapes.primitives:
            middle = one.pose.compose(shape.pose)
            if shape.kind == 'CONE':
                marker = _triangles(scale * _cone(shape), middle)
            else:
                marker = Marker(pose=pose_to_message(middle))
                marker.type = {'BOX': Marker.CUBE, 'SPHERE': Marker.SPHERE, 'CYLINDER': Marker.CYLINDER}[shape.kind]
                x, y, z = (scale * size for size in _extent(shape))
                marker.scale.x, marker.scale.y, marker.scale.z = x, y, z
            array.markers.append(marker)
        for mesh in one.shapes.meshes:
            array.markers.append(_triangles(scale * mesh.vertices[mesh.triangles].reshape(-1, 3), one.pose))
        for number, marker in enumerate(array.markers[-len(one.shapes.primitives) - len(one.shapes.meshes) :]):
            marker.header, marker.ns, marker.id = header, one.name, number
            red, green, blue, opacity = COLOUR
            marker.color = ColorRGBA(r=red, g=green, b=blue, a=opacity)
    return array


def _scaled(pose: Pose, scale: float) -> Pose:
    """A pose in a model that is so much larger."""
    return Pose(pose.rotation, scale * pose.translation)


def _extent(shape: PrimitiveShape) -> tuple[float, float, float]:
    """Sizes of the bounding box of a primitive, its own frame."""
    if shape.kind == 'BOX':
        x, y, z = shape.dimensions
        return x, y, z
    if shape.kind == 'SPHERE':
        return (2.0 * shape.dimensions[0],) * 3
    height, radius = shape.dimensions
    return 2.0 * radius, 2.0 * radius, height


def _cone(shape: PrimitiveShape) -> FloatArray:
    """(n, 3) corners of triangles of a cone, three by three, its own frame."""
    height, radius = shape.dimensions
    angle = np.linspace(0.0, 2.0 * np.pi, CONE_FACETS + 1)
    rim = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), -0.5 * height)])
    tip, foot = np.array([0.0, 0.0, 0.5 * height]), np.array([0.0, 0.0, -0.5 * height])
    parts = [corner for a, b in zip(rim, rim[1:]) for corner in (a, b, tip, b, a, foot)]
    return np.array(parts)


def _triangles(corners: FloatArray, pose: Pose) -> Marker:
    """A marker of triangles."""
    marker = Marker(type=Marker.TRIANGLE_LIST, pose=pose_to_message(pose))
    marker.scale.x = marker.scale.y = marker.scale.z = 1.0
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in corners.tolist()]
    return marker
