"""What matcher_node says in messages that others take: covariances, detections, frames on objects, symmetries."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from csg_renderer import MeshOutline, planning_scene
from csg_renderer.features.collision_shapes import box_shape
from msgs_py import Interpretation, Pose
from msgs_py.codecs import (
    Detection,
    SceneObject,
    collision_messages,
    collision_object,
    detection_messages,
    detections_to_message,
    objects_to_markers,
    pose_to_stamped,
    pose_with_covariance_stamped,
    poses_to_transforms,
    removal,
)
from msgs_py.node_runtime.runtime import GraphNode
from msgs_py.shapes import CollisionShapes, MeshShape

from .model.equal_poses import symmetry_group
from .model.index import ModelIndex, model_box


class Answers:
    """Publishers beside those of plain poses.

    Parameters
    ----------
    node : GraphNode
        Whose they are.
    topic : str
        Under which they stand.
    """

    def __init__(self, node: GraphNode[Any], topic: str) -> None:
        self._node = node
        self._topic = topic
        self._poses: dict[str, Publisher] = {}
        self._frames: dict[tuple[str, str], Publisher] = {}
        self._models: dict[str, ModelIndex] = {}
        self._vision = detection_messages()
        self._detections: Publisher | None = None
        if self._vision is not None:
            self._detections = node.create_output(self._vision.Detection3DArray, 'detections')
        self._moveit = collision_messages()
        kind = MarkerArray if self._moveit is None else self._moveit.CollisionObject
        self._scene = node.create_output(kind, 'scene_objects')
        self._shapes: dict[str, CollisionShapes] = {}
        self._in_scene: set[str] = set()
        # Who comes later hears it, too.
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._symmetries = node.owned(node.create_publisher(String, f'{topic}/symmetries', latched))

    def load(self, models: Iterable[ModelIndex], topic_names: Mapping[str, str]) -> None:
        """Take over the models; topic_names : the last part of each one's topic, by its name."""
        self._models = {model.name: model for model in models}
        self._shapes.clear()
        for name in set(self._poses) - set(self._models):
            self._node.destroy_publisher(self._poses.pop(name))
            self._make_frames(name, '')
        for name in sorted(set(self._models) - set(self._poses)):
            topic = f'{self._topic}/{topic_names[name]}/with_covariance'
            self._poses[name] = self._node.create_output(PoseWithCovarianceStamped, topic)
        for name in self._models:
            self._make_frames(name, f'{self._topic}/{topic_names[name]}')

    def tell_symmetries(self) -> None:
        """Publish what each model looks the same under, latched."""
        groups = {name: symmetry_group(model) for name, model in self._models.items()}
        self._symmetries.publish(String(data=json.dumps(groups)))

    def _make_frames(self, name: str, topic: str) -> None:
        """Publishers of the frames of a model, which may have changed."""
        for frame in [frame for model, frame in self._frames if model == name]:
            if name not in self._models or frame not in self._models[name].frames:
                self._node.destroy_publisher(self._frames.pop((name, frame)))
        for frame in self._models[name].frames if name in self._models else ():
            if (name, frame) not in self._frames:
                self._frames[name, frame] = self._node.create_output(PoseStamped, f'{topic}/frames/{frame}')

    def publish_scene(
        self, found: Sequence[Interpretation], instances: Sequence[str], remembered: Sequence[str], header: Header
    ) -> None:
        """Put what was found into the scene of a planner, and take out what is forgotten."""
        if not self._node.wanted(self._scene):
            return
        objects = []
        for one, name in zip(found, instances):
            if one.model not in self._shapes:
                self._shapes[one.model] = collision_shapes(self._models[one.model])
                if self._shapes[one.model].note is not None:
                    self._node.get_logger().warning(f'scene_objects: {one.model}: {self._shapes[one.model].note}')
            shapes, frames = self._shapes[one.model], self._models[one.model].frames
            objects.append(SceneObject(name, one.model, one.pose, shapes, frames))
        if self._moveit is None:
            self._scene.publish(objects_to_markers(objects, header))
            return
        for name in sorted(self._in_scene.difference(remembered)):
            self._scene.publish(removal(name, header, self._moveit))
        for thing in objects:
            self._scene.publish(collision_object(thing, header, self._moveit))
        self._in_scene = (self._in_scene & set(remembered)) | set(instances)

    def publish(self, found: Sequence[Interpretation], instances: Sequence[str], header: Header) -> None:
        """Say what was found, best first, and which object each is."""
        said: set[str] = set()
        for one in found:
            if one.model not in said:
                said.add(one.model)
                self._poses[one.model].publish(pose_with_covariance_stamped(one.pose, one.covariance, header))
                for frame, pose in self._models[one.model].frames.items():
                    self._frames[one.model, frame].publish(pose_to_stamped(placed(one.pose, pose), header))
        if self._detections is not None and self._node.wanted(self._detections):
            detections = [
                Detection(
                    one.model,
                    name,
                    score(one),
                    one.pose,
                    one.covariance,
                    *model_box(self._models[one.model]),
                    one.ambiguous_poses,
                )
                for one, name in zip(found, instances)
            ]
            self._detections.publish(detections_to_message(detections, header, self._vision))


def collision_shapes(model: ModelIndex) -> CollisionShapes:
    """The space that a model takes; its bounding box where neither a mesh nor a solid with bounds is known."""
    if isinstance(model.shape, MeshOutline):
        return CollisionShapes((), (MeshShape(model.shape.vertices, model.shape.triangles),))
    if model.shape is not None and np.isfinite(model.shape.box).all():
        return planning_scene(model.shape.solid)
    return CollisionShapes((box_shape(*model_box(model)),), note='the bounding box: only features are known')


def placed(pose: Pose, frame: Pose) -> Pose:
    """A frame on an object, camera_T_frame; what scales the object moves the frame and does not scale it."""
    return Pose(pose.rotation @ frame.rotation, pose.apply(frame.translation))


def transforms(
    poses: Mapping[str, Pose], models: Mapping[str, ModelIndex], prefix: str, header: Header
) -> list[TransformStamped]:
    """The frames of objects and, on each, those that its model names.

    Parameters
    ----------
    poses : mapping of str to Pose
        Of objects, by their models; header's frame_T_model.
    models : mapping of str to ModelIndex
    prefix : str
        Put before every frame.
    header : std_msgs.msg.Header

    Returns
    -------
    list of geometry_msgs.msg.TransformStamped
        Frame ``prefix + model`` from the header's, ``prefix + model/frame`` from that.
    """
    made = poses_to_transforms({prefix + name: pose for name, pose in poses.items()}, header)
    for name, pose in poses.items():
        scaled = {
            f'{prefix}{name}/{frame}': Pose(one.rotation, pose.scale * one.translation)
            for frame, one in models[name].frames.items()
        }
        made += poses_to_transforms(scaled, Header(stamp=header.stamp, frame_id=prefix + name))
    return made


def score(found: Interpretation) -> float:
    """The probability that a search for a model that is not there brings less evidence; 0 where it was not weighed."""
    return 0.0 if math.isnan(found.chance) else 1.0 - found.chance
