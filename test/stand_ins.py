"""Message packages that do not come with the wheels, made from their published definitions.

A class made here takes the fields of its definition, in their types, and no others, as rclpy's own classes do when they
check fields. The definitions are those of vision_msgs 4.1 and moveit_msgs 2 (ROS 2 Humble to Jazzy), without comments.
"""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import geometry_msgs.msg
import sensor_msgs.msg
import shape_msgs.msg
import std_msgs.msg

VISION_MSGS = {
    'ObjectHypothesis': 'string class_id\nfloat64 score',
    'ObjectHypothesisWithPose': 'ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose',
    'BoundingBox3D': 'geometry_msgs/Pose center\ngeometry_msgs/Vector3 size',
    'Detection3D': 'std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\nstring id',
    'Detection3DArray': 'std_msgs/Header header\nDetection3D[] detections',
}
OBJECT_RECOGNITION_MSGS = {'ObjectType': 'string key\nstring db'}
MOVEIT_MSGS = {
    'CollisionObject': """std_msgs/Header header
geometry_msgs/Pose pose
string id
object_recognition_msgs/ObjectType type
shape_msgs/SolidPrimitive[] primitives
geometry_msgs/Pose[] primitive_poses
shape_msgs/Mesh[] meshes
geometry_msgs/Pose[] mesh_poses
shape_msgs/Plane[] planes
geometry_msgs/Pose[] plane_poses
string[] subframe_names
geometry_msgs/Pose[] subframe_poses
byte ADD=0
byte REMOVE=1
byte APPEND=2
byte MOVE=3
byte operation"""
}
PLAIN: dict[str, type] = {'string': str, 'float64': float, 'byte': bytes, 'int8': int, 'uint8': int, 'uint64': int}
OTHERS = {
    'geometry_msgs': geometry_msgs.msg,
    'std_msgs': std_msgs.msg,
    'sensor_msgs': sensor_msgs.msg,
    'shape_msgs': shape_msgs.msg,
}
CONSTANT = re.compile(r'(?P<kind>\w+) (?P<name>[A-Z_0-9]+)\s*=\s*(?P<value>\d+)')


def messages(package: str, definitions: dict[str, str], others: dict[str, Any] | None = None) -> SimpleNamespace:
    """The module package.msg; definitions stand in the order of their use; others : further packages that they use."""
    module = SimpleNamespace(__name__=f'{package}.msg')
    known = OTHERS | (others or {})
    for name, text in definitions.items():
        fields: dict[str, tuple[type, bool]] = {}
        constants: dict[str, Any] = {}
        for line in text.splitlines():
            if constant := CONSTANT.fullmatch(line):
                value = int(constant['value'])
                constants[constant['name']] = bytes([value]) if constant['kind'] == 'byte' else value
                continue
            kind, field = line.split()
            plain, many = kind.removesuffix('[]'), kind.endswith('[]')
            if '/' in plain:
                where, what = plain.split('/')
                fields[field] = getattr(known[where], what), many
            else:
                fields[field] = PLAIN.get(plain) or getattr(module, plain), many
        setattr(module, name, _message(package, name, fields, constants))
    return module


def _message(package: str, name: str, fields: dict[str, tuple[type, bool]], constants: dict[str, Any]) -> type:
    def start(self: Any, **given: Any) -> None:
        for field, (kind, many) in fields.items():
            setattr(self, field, given.pop(field, [] if many else b'\0' if kind is bytes else kind()))
        assert not given, f'{name} has no {", ".join(given)}'

    def put(self: Any, field: str, value: Any) -> None:
        assert field in fields, f'{name} has no {field}'
        kind, many = fields[field]
        for one in value if many else [value]:
            assert isinstance(one, kind), f'{name}.{field}: expected {kind.__name__}, got {type(one).__name__}'
        object.__setattr__(self, field, value)

    return type(name, (), {'__init__': start, '__setattr__': put, '__module__': f'{package}.msg', **constants})


class Sent:
    """In place of a publisher of such messages: what it was given."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.messages: list[Any] = []

    def publish(self, message: Any) -> None:
        self.messages.append(message)

    def get_subscription_count(self) -> int:
        return 1


def sending(node_class: type, module: SimpleNamespace, sent: dict[str, Sent]) -> type:
    """A node class whose messages of a stand-in are kept in ``sent``, by topic."""

    class Sending(node_class):  # type: ignore[misc, valid-type]
        def create_publisher(self, kind: type, topic: str, *arguments: Any, **options: Any) -> Any:
            if kind in vars(module).values():
                sent[topic] = Sent(topic)
                return sent[topic]
            return super().create_publisher(kind, topic, *arguments, **options)

        def destroy_publisher(self, publisher: Any) -> bool:
            return isinstance(publisher, Sent) or bool(super().destroy_publisher(publisher))

    return Sending
