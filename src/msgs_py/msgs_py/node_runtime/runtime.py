"""What every node of the graph shares: parameters from a Config, QoS, guarded callbacks, diagnostics, shutdown.

With codecs this is the only part of the package that needs ROS, and the only one that imports rclpy.
"""

from __future__ import annotations

import contextlib
import copy
import difflib
import math
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Protocol, TypeVar, cast

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from ..numeric.steps import CompileStep, Preparation
from .adapted import Adapted
from .camera_input import COMPRESSED, INFO, RAW, CameraImages, CameraTopics, message_type
from .config import Config, ParameterSpec
from .hand_over import Handing, HandOver, Taker
from .health import Health, SequenceGaps, shortened
from .inbox import Inbox
from .managed import ManagedNode
from .renaming import notice
from .settings import (
    COMPILING_HEARD_S,
    DIAGNOSTICS_DEPTH,
    DIAGNOSTICS_PERIOD_S,
    INFO_WAIT_S,
    NANOSECONDS,
    PENDING_SETS,
    QUEUE_DEPTH,
    REPEAT_LOG_S,
    SILENCE_LOG_S,
    SILENCE_S,
    UNBOUNDED_FLOAT,
    UNBOUNDED_INTEGER,
)
from .stamp_sync import StampSync, stamp_ns
from .transport import make_room_for_images
from .until import Until

# REP-2003: publishers reliable, so that either kind of subscriber is served; subscribers best effort, so that either
# kind of publisher is heard.
OUTPUT_QOS = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST, depth=QUEUE_DEPTH, reliability=QoSReliabilityPolicy.RELIABLE
)
INPUT_QOS = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST, depth=QUEUE_DEPTH, reliability=QoSReliabilityPolicy.BEST_EFFORT
)
# Its value in a status says how far compiling is; empty when a node is ready.
COMPILING_KEY = 'compiling'
LIFECYCLE_KEY = 'lifecycle'
# What a node that takes stereo pairs listens to; a set of them has one stamp.
STEREO_TOPICS = ('left/image_rect', 'left/camera_info', 'right/image_rect', 'right/camera_info')

_ARRAY_TYPES = {
    str: Parameter.Type.STRING_ARRAY,
    int: Parameter.Type.INTEGER_ARRAY,
    float: Parameter.Type.DOUBLE_ARRAY,
    bool: Parameter.Type.BOOL_ARRAY,
}

_C = TypeVar('_C', bound=Config)


@dataclass(frozen=True)
class StereoMessages:
    """Four messages of one stamp.

    Parameters
    ----------
    left, right : sensor_msgs.msg.Image
    left_info, right_info : sensor_msgs.msg.CameraInfo
    """

    left: Image
    left_info: CameraInfo
    right: Image
    right_info: CameraInfo


class GraphNode(ManagedNode, Generic[_C]):
    """A node of the recognition graph, ``GraphNode[ItsConfig]``.

    Parameters
    ----------
    name : str
        The node's name.
    config_class : type of Config
        Its parameters are declared.
    hand_over : HandOver, optional
        With the other nodes of its process.
    **kwargs
        For rclpy's Node: context, namespace, parameter_overrides, ...

    Attributes
    ----------
    health : Health
        Counters, which /diagnostics shows.
    inbox : Inbox
        Of what other threads have for the node.
    brief : bool
        Whether every callback of such nodes takes next to no time, for what takes long is done beside it: then who
        hands something over may call them.
    """

    brief: ClassVar[bool] = False

    def __init__(self, name: str, config_class: type[_C], hand_over: HandOver | None = None, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self._hand_over = hand_over
        if hand_over is not None:
            hand_over.join(self, list(self._overrides.values()))
        self.inbox = Inbox(self)
        self.health = Health(time.monotonic())
        self._refused: dict[str, str] = {}
        self._sync: StampSync | None = None
        self._optional_syncs: list[StampSync] = []
        self._received: dict[str, int] = {}
        self._callback_start = time.monotonic()
        self._preparation: Preparation | None = None
        self._cancelled: list[Preparation] = []
        self._ready_at = -math.inf
        self._newest: dict[str, tuple[Callable[..., None], Any]] = {}
        self._told = ''
        self._heard_compiling: dict[str, tuple[float, str]] = {}
        self._silence_logged = -SILENCE_LOG_S
        self._old_names: list[str] = []
        self._ignored: list[str] | None = None
        self._accept_old_names(config_class)
        self._config = self._declare(config_class)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)
        self._diagnostics_out = self.create_publisher(DiagnosticArray, '/diagnostics', DIAGNOSTICS_DEPTH)
        self._diagnostics_in: Subscription | None = self.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, DIAGNOSTICS_DEPTH
        )
        # A steady clock: diagnostics go on when simulated time stands still.
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._publish_diagnostics, clock=self._steady_clock)
        self.create_service(Trigger, '~/reset', self._on_reset)

    # -- to be overridden --------------------------------------------------------------------------------------

    def check_config(self, new: _C) -> None:
        """Refuse a configuration: raise ValueError with what was expected. No side effects."""

    def on_config(self, old: _C, new: _C) -> None:
        """The configuration has changed.

        Parameters
        ----------
        old, new : Config
            Before and now; they differ.
        """

    def reset(self) -> str:
        """Forget everything about earlier inputs; return what was forgotten."""
        return 'counters'

    def why_silent(self) -> str | None:
        """A reason of this node's own why nothing comes out."""
        return None

    def doubt(self) -> str | None:
        """What is wrong with the inputs although results come; None when nothing is."""
        return None

    def report_values(self) -> dict[str, object]:
        """More key and value pairs for /diagnostics."""
        return {}

    # -- its life ----------------------------------------------------------------------------------------------

    def unusable(self) -> str:
        """Values given at the start that were refused: a manager is told, rather than defaults used in their place."""
        return '; '.join(self._refused.values())

    def _quiet(self) -> None:
        """As ManagedNode's; what was heard is forgotten, so that nothing old is answered later."""
        super()._quiet()
        self._sync, self._optional_syncs = None, []
        self._received.clear()
        self._newest.clear()

    def _forget(self) -> None:
        """As ManagedNode's; what has not been compiled is not begun."""
        if self._preparation is not None:
            self._preparation.cancel()
            self._cancelled.append(self._preparation)
            self._preparation, self._told = None, ''
        super()._forget()

    # -- compiling ---------------------------------------------------------------------------------------------

    def prepare(self, steps: Sequence[CompileStep]) -> None:
        """Run steps in a thread; until they are done the newest input of each topic is kept, and nothing processed.

        Parameters, services and diagnostics answer meanwhile, and the diagnostics tell which step runs.
        """
        if not steps:
            return
        self._preparation = Preparation(steps, lambda: self.inbox.put(self._on_prepared))
        self._preparation.start()

    @property
    def compiling(self) -> str:
        """How far compiling is: ``'2 of 5: curves in space'``; empty when the node is ready."""
        return '' if self._preparation is None else self._preparation.progress

    @property
    def is_busy_compiling(self) -> bool:
        """Whether a thread compiles, also for a node that was destroyed."""
        return any(one.running for one in (self._preparation, *self._cancelled) if one is not None)

    async def prepared(self) -> None:
        """For services that cannot answer before all is compiled."""
        await Until(lambda: not self.compiling)

    def _on_prepared(self) -> None:
        """All is compiled: what waits is processed. Also called when it was before, and then does nothing."""
        if self.compiling or self._preparation is None:
            return
        for error in self._preparation.errors:
            self.problem(f'compiling: {error}')
        if self._told:
            self.get_logger().info(f'compiled, after {time.monotonic() - self.health.started:.0f} s')
        self._preparation, self._told, self._ready_at = None, '', time.monotonic()
        waiting, self._newest = self._newest, {}
        for topic, (callback, message) in waiting.items():
            self._guard(topic, callback)(message)

    def _when_prepared(self, topic: str, callback: Callable[..., None]) -> Callable[[Any], None]:
        """The callback, of which the newest call is kept until all is compiled."""

        def call(message: Any) -> None:
            if self._preparation is not None:
                self.health.passed_over += topic in self._newest
                self._newest[topic] = (callback, message)
            else:
                callback(message)

        return call

    def _tell_compiling(self) -> None:
        """Log each step that takes long enough to be seen; loading what was compiled before is not worth a line."""
        if self.compiling and self.compiling != self._told:
            self._told = self.compiling
            self.get_logger().info(f'compiling: {self._told}')

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Which other nodes are compiling."""
        for status in message.status:
            text = next((item.value for item in status.values if item.key == COMPILING_KEY), '')
            if text and status.name != self.get_fully_qualified_name():
                self._heard_compiling[status.name] = (time.monotonic(), text)
            else:
                self._heard_compiling.pop(status.name, None)

    def _others_compiling(self) -> str:
        """Who compiles, and how far it is."""
        oldest = time.monotonic() - COMPILING_HEARD_S
        return '; '.join(
            f'{name} is compiling: {text}' for name, (at, text) in self._heard_compiling.items() if at > oldest
        )

    def destroy_subscription(self, subscription: Any) -> bool:
        """As rclpy's, of what listen gave."""
        if isinstance(subscription, Taker):
            subscription.close()
            return True
        return bool(super().destroy_subscription(subscription))

    def destroy_publisher(self, publisher: Any) -> bool:
        """As rclpy's, of what create_output gave."""
        if isinstance(publisher, Handing):
            publisher.close()
            publisher = publisher.publisher
        return bool(super().destroy_publisher(publisher))

    def destroy_node(self) -> None:
        """As rclpy's; what has not been compiled is not begun."""
        if self._preparation is not None:
            self._preparation.cancel()
        self.inbox.close()
        super().destroy_node()  # type: ignore[no-untyped-call]

    # -- parameters --------------------------------------------------------------------------------------------

    @property
    def config(self) -> _C:
        """The current configuration."""
        return self._config

    @property
    def _overrides(self) -> dict[str, Parameter]:
        """Values given at the start; rclpy has no public view of them."""
        return getattr(self, '_parameter_overrides', {})

    def _accept_old_names(self, config_class: type[_C]) -> None:
        """Values given under a parameter's old name count for the new one, unless that is given too."""
        for old, new in config_class.former_names().items():
            given = self._overrides.pop(old, None)
            if given is not None:
                self._old_name_used('parameter', old, new)
                self._overrides.setdefault(new, Parameter(new, given.type_, given.value))

    def _old_name_used(self, kind: str, old: str, new: str) -> None:
        """Say so, once, in the log, and from now on in the diagnostics."""
        text = notice(kind, old, new)
        if text not in self._old_names:
            self._old_names.append(text)
            self.get_logger().warning(text)

    def _ignored_overrides(self) -> list[str]:
        """What was given at the start and no parameter has taken: ROS says nothing of a misspelt name."""
        if self._ignored is None:
            known = [*self._parameters, *type(self._config).former_names()]
            shared = (lambda name: False) if self._hand_over is None else self._hand_over.knows
            self._ignored = [name for name in self._overrides if not (self.has_parameter(name) or shared(name))]
            for name in self._ignored:
                near = difflib.get_close_matches(name, known, n=1)
                hint = f'; did you mean {near[0]}?' if near else ''
                self.get_logger().warning(f'parameter {name}: unknown to {self.get_name()}, ignored{hint}')
        return self._ignored

    def _declare(self, config_class: type[_C]) -> _C:
        """Declare every parameter. An unusable start-up value is reported, and the default taken instead."""
        given = {}
        for spec in config_class.parameters():
            try:
                self._declare_one(spec)
                given[spec.name] = spec.check(self._declared_value(spec))
            except (InvalidParameterTypeException, InvalidParameterValueException, ValueError) as error:
                self._take_default(spec, error)
        # Rules that span parameters may hold of all values together, and of none before the others.
        with contextlib.suppress(ValueError):
            return config_class().changed(given)
        config = config_class()
        for spec in config_class.parameters():
            try:
                config = config.changed({spec.name: given[spec.name]} if spec.name in given else {})
            except ValueError as error:
                self._take_default(spec, error)
        return config

    def _take_default(self, spec: ParameterSpec, error: Exception) -> None:
        """Say that a start-up value is unusable, and take the default instead."""
        self._refused[spec.name] = str(error)
        self.problem(f'{error}; using the default {spec.default!r}')
        if self.has_parameter(spec.name):
            self.describe_parameter(spec.name).read_only = False  # or it could not be taken back
            self.undeclare_parameter(spec.name)
        self._declare_one(spec, ignore_override=True)

    def _declare_one(self, spec: ParameterSpec, ignore_override: bool = False) -> None:
        """Declare one parameter, with what a user's tools show of it."""
        descriptor = ParameterDescriptor(
            description=spec.description + (f' [{spec.unit}]' if spec.unit else ''),
            additional_constraints=spec.range_text,
            read_only=spec.read_only,
            # An integer is welcome where a number is expected; the type is checked with the range, by the Config.
            dynamic_typing=spec.kind is float,
        )
        low, high = spec.minimum, spec.maximum
        if spec.kind is float and (low is not None or high is not None):
            descriptor.floating_point_range = [
                FloatingPointRange(
                    from_value=float(-UNBOUNDED_FLOAT if low is None else low),
                    to_value=float(UNBOUNDED_FLOAT if high is None else high),
                )
            ]
        elif spec.kind is int and (low is not None or high is not None):
            descriptor.integer_range = [
                IntegerRange(
                    from_value=int(-UNBOUNDED_INTEGER if low is None else low),
                    to_value=int(UNBOUNDED_INTEGER if high is None else high),
                    step=1,
                )
            ]
        if spec.kind is not tuple:
            self.declare_parameter(spec.name, spec.default, descriptor, ignore_override=ignore_override)
            return
        # An empty list has no type of its own, so the type is declared and the value set, and only then locked.
        array_type = _ARRAY_TYPES[spec.element]
        descriptor.read_only = False
        self.declare_parameter(spec.name, array_type, descriptor, ignore_override=ignore_override)
        if self.get_parameter_or(spec.name, Parameter(spec.name)).value is None:
            assert isinstance(spec.default, tuple)
            self.set_parameters([Parameter(spec.name, array_type, list(spec.default))])
        if spec.read_only:
            locked = copy.deepcopy(descriptor)  # the node has kept the other one
            locked.read_only, locked.type = True, array_type.value
            self.set_descriptor(spec.name, locked)

    def _declared_value(self, spec: ParameterSpec) -> Any:
        value = self.get_parameter(spec.name).value
        return list(value) if spec.kind is tuple else value

    def _candidate(self, parameters: list[Parameter]) -> _C:
        """The configuration with these changes; parameters that are not ours (QoS, use_sim_time) are left alone."""
        names = {spec.name for spec in type(self._config).parameters()}
        ours = {p.name: p.value for p in parameters if p.name in names}
        candidate = self._config.changed(ours)
        if ours:
            self.check_config(candidate)
        return candidate

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """As rclpy's, which forgets to say which name it does not know; old names are taken for the new ones."""
        former = type(self._config).former_names()
        for old in [p.name for p in parameter_list if p.name in former]:
            self._old_name_used('parameter', old, former[old])
        parameter_list = [
            Parameter(former[p.name], p.type_, p.value) if p.name in former else p for p in parameter_list
        ]
        unknown = [p.name for p in parameter_list if not self.has_parameter(p.name)]
        if unknown:
            reason = f'parameter {unknown[0]}: unknown to {self.get_name()}'
            return SetParametersResult(successful=False, reason=reason)
        return super().set_parameters_atomically(parameter_list)

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._candidate(parameters)
        except Exception as error:  # what a name makes of a file system, a parser or a grammar is no reason to die
            text = str(error) if isinstance(error, ValueError) else f'{parameters[0].name}: {error}'
            self.problem(text)
            return SetParametersResult(successful=False, reason=shortened(text))
        return SetParametersResult(successful=True)

    def _on_parameters_set(self, parameters: list[Parameter]) -> None:
        old, new = self._config, self._candidate(parameters)
        for given in parameters:
            self._refused.pop(given.name, None)
        if new != old:
            self._config = new
            if self.configured:
                self._guard('parameters', self.on_config)(old, new)

    # -- topics ------------------------------------------------------------------------------------------------

    def create_output(self, message_type: type, topic: str, formerly: tuple[str, ...] = ()) -> Publisher:
        """A publisher, reliable, with a short queue; parameters may override its QoS.

        Parameters
        ----------
        message_type : type
        topic : str
        formerly : tuple of str
            Old names of the topic; who still listens there is served, and a warning says so.
        """

        def publisher(name: str) -> Publisher:
            # A copy: rclpy writes what parameters override into the profile it is given.
            made = self.create_publisher(
                message_type,
                name,
                copy.copy(OUTPUT_QOS),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
            return self.owned(made if self._hand_over is None else self._hand_over.handing(self, made))

        if not formerly:
            return publisher(topic)
        return cast(
            Publisher,
            _AlsoUnderOldNames(
                publisher(topic),
                {old: publisher(old) for old in formerly},
                lambda old: self._old_name_used('topic', old, topic),
            ),
        )

    def give(self, publisher: Publisher, value: Adapted[Any]) -> None:
        """Publish a value's message; nodes of this process that listen with ``adapted`` get the value.

        Parameters
        ----------
        publisher : rclpy.publisher.Publisher
            Of :meth:`create_output`.
        value : Adapted
        """
        publisher.publish(value if isinstance(publisher, Handing) else value.message)

    def wanted(self, publisher: Publisher) -> bool:
        """Whether anybody listens; heavy outputs are made only then."""
        return publisher.get_subscription_count() > 0

    def listen(
        self,
        message_type: type,
        topic: str,
        callback: Callable[[Any], None],
        formerly: tuple[str, ...] = (),
        optional: bool = False,
        adapted: bool = False,
    ) -> Subscription:
        """A subscription whose callback may raise: that is reported, and the node lives on.

        Parameters
        ----------
        message_type : type
        topic : str
        callback : callable
            Takes the message.
        formerly : tuple of str
            Old names of the topic; what comes there is taken too, with a warning.
        optional : bool
            Nothing is wrong when nothing comes.
        adapted : bool
            The callback also takes an Adapted, which nodes of this process give in place of its message.
        """
        if not adapted:
            callback = _of_message(callback)
        return self._subscribe(message_type, topic, self._when_prepared(topic, callback), formerly, optional)

    def _subscribe(
        self,
        message_type: type,
        topic: str,
        callback: Callable[[Any], None],
        formerly: tuple[str, ...] = (),
        optional: bool = False,
    ) -> Subscription:
        """As :meth:`listen`, also while the node compiles."""
        for old in formerly:

            def on_old(message: Any, old: str = old) -> None:
                self._old_name_used('topic', old, topic)
                guarded(message)

            self._inputs.append(self.create_subscription(message_type, old, on_old, INPUT_QOS))
        if not optional:
            self._received.setdefault(topic, 0)
        guarded = self._guard(topic, callback)
        gaps = SequenceGaps()

        def on_message(message: Any, info: Any) -> None:
            if not self.active:
                return  # it was on its way when the node was deactivated
            if not optional:
                self._received[topic] += 1
            # Numbers of several writers cannot be told apart; then nothing is counted rather than something wrong.
            missed = gaps.missed(info.get('publication_sequence_number'))
            if subscription.get_publisher_count() > 1:
                missed = 0
            if missed and self.health.lost == 0:
                self.get_logger().warning(
                    f'{topic}: messages are lost (counted as lost_inputs): this node or the network is too slow for '
                    f'them. If its publisher is reliable, set qos_overrides.{subscription.topic_name}'
                    '.subscription.reliability to reliable'
                )
            self.health.lost += missed
            guarded(message)

        subscription: Subscription | Taker
        name = self._transported(topic)
        if self._hand_over is not None:
            subscription = self._hand_over.listen(self, self.inbox, message_type, name, on_message, INPUT_QOS)
        else:
            subscription = self.create_subscription(
                message_type,
                name,
                on_message,  # type: ignore[arg-type]
                copy.copy(INPUT_QOS),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
        self._inputs.append(subscription)
        return cast(Subscription, subscription)

    def listen_stereo(
        self,
        callback: Callable[[StereoMessages], None],
        queue_size: int = PENDING_SETS,
        tolerance_s: float = 0.0,
        optional: bool = False,
    ) -> None:
        """Subscribe to the four stereo topics.

        Parameters
        ----------
        callback : callable
            Takes StereoMessages of one stamp.
        queue_size : int
            Incomplete sets that are kept.
        tolerance_s : float
            Largest difference of stamps inside a set, seconds.
        optional : bool
            Nothing is wrong when none come.
        """

        def on_set(messages: dict[str, Any]) -> None:
            callback(StereoMessages(*(messages[name] for name in STEREO_TOPICS)))

        self.listen_together('stereo pair', STEREO_TOPICS, on_set, queue_size, tolerance_s, optional)

    def listen_images(
        self,
        topics: CameraTopics,
        callback: Callable[[CameraImages], None],
        queue_size: int = PENDING_SETS,
        tolerance_s: float = 0.0,
        optional: bool = False,
    ) -> None:
        """Subscribe to the images of cameras, raw or compressed, and to their camera_info.

        Parameters
        ----------
        topics : CameraTopics
        callback : callable
            Takes the CameraImages of one stamp.
        queue_size, tolerance_s, optional
            As for :meth:`listen_stereo`.
        """

        def on_set(messages: dict[str, Any]) -> None:
            images, infos = ([messages[name] for name in names] for names in (topics.images, topics.infos))
            callback(CameraImages(topics, images, infos))

        self.listen_together(topics.source, topics.all, on_set, queue_size, tolerance_s, optional)

    def listen_together(
        self,
        source: str,
        topics: Sequence[str],
        callback: Callable[[dict[str, Any]], None],
        queue_size: int,
        tolerance_s: float,
        optional: bool = False,
    ) -> None:
        """Subscribe to topics of images and camera_info that belong together.

        Where camera_info does not bear the stamps of the images (a driver that publishes it once, or at a rate of its
        own), the last one counts; what was published before this node came is asked for where it is kept.

        Parameters
        ----------
        source : str
            What a set of them is called in messages.
        topics : sequence of str
            Those that end in camera_info carry one, those in compressed a compressed image, the others images.
        callback : callable
            Takes the messages of one stamp by their topics.
        queue_size, tolerance_s, optional
            As for :meth:`listen_stereo`.
        """
        on_set = self._when_prepared(source, self._guard(source, callback))
        lasting = [topic for topic in topics if topic.endswith(INFO)]
        sync = StampSync(topics, queue_size, round(tolerance_s * NANOSECONDS), lasting=lasting)
        if optional:
            self._optional_syncs.append(sync)
        else:
            self._sync = sync

        kept: set[str] = set()

        def joined(topic: str) -> Callable[[Any], None]:
            def on_message(message: Any) -> None:
                if topic in kept and message == sync.last(topic):
                    return  # both subscriptions hear what comes
                complete = sync.add(topic, stamp_ns(message.header), message)
                if complete is not None:
                    on_set(complete)

            return on_message

        takers = {topic: joined(topic) for topic in topics}
        for topic, take in takers.items():
            self._subscribe(message_type(topic), topic, take, optional=optional)

        def look() -> None:
            for topic in sync.unheard:
                if topic not in kept and self._is_kept(topic):
                    kept.add(topic)
                    self._ask_for_kept(topic, takers[topic])
            complete = sync.overdue()
            if complete is not None:
                on_set(complete)

        self.every(INFO_WAIT_S, look, clock=self._steady_clock)

    def _transported(self, topic: str) -> str:
        """A topic of compressed images goes with its base: remapping that remaps it, as image_transport has it."""
        base = topic.removesuffix(f'/{COMPRESSED}')
        return topic if base == topic else f'{self.resolve_topic_name(base)}/{COMPRESSED}'

    def _is_kept(self, topic: str) -> bool:
        """Whether a publisher keeps its last messages for who comes late ("latched")."""
        publishers = self.get_publishers_info_by_topic(topic)
        return any(one.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for one in publishers)

    def _ask_for_kept(self, topic: str, take: Callable[[Any], None]) -> None:
        """Subscribe to what is kept of a topic, which a subscription to what comes does not get.

        It is not made beside every subscription: all publishers that keep nothing would warn of it.
        """
        asked = copy.copy(INPUT_QOS)
        asked.durability, asked.reliability = QoSDurabilityPolicy.TRANSIENT_LOCAL, QoSReliabilityPolicy.RELIABLE
        guarded = self._guard(topic, take)

        def on_kept(message: Any) -> None:
            if topic in self._received:
                self._received[topic] += 1
            guarded(message)

        self._inputs.append(self.create_subscription(message_type(topic), topic, on_kept, asked))

    def _guard(self, source: str, callback: Callable[..., None]) -> Callable[..., None]:
        """A callback that reports what the given one raises, under the name of its source."""

        def guarded(*arguments: Any) -> None:
            self._callback_start = time.monotonic()
            try:
                callback(*arguments)
            except ValueError as error:  # what a checked input raises; its text names the field
                self.health.dropped += 1
                self.problem(f'{source}: {error}')
            except Exception as error:  # a fault of ours must not take the robot's node down
                self.health.dropped += 1
                where = traceback.extract_tb(error.__traceback__)[-1]
                self.problem(f'{source}: {type(error).__name__}: {error} ({where.name}, line {where.lineno})')
                self.get_logger().debug(traceback.format_exc())

        return guarded

    def attempt(self, source: str, work: Callable[..., None], *arguments: Any, begun: float | None = None) -> None:
        """Call what may raise: that is reported under the name of its source, and the node lives on.

        Parameters
        ----------
        source : str
        work : callable
        *arguments
            Of it.
        begun : float, optional
            Seconds of time.monotonic() from which the latency of its input runs; from now without it.
        """

        def timed() -> None:
            self._callback_start = self._callback_start if begun is None else begun
            work(*arguments)

        self._guard(source, timed)()

    # -- health ------------------------------------------------------------------------------------------------

    def done(self, header: Any = None) -> None:
        """Count an input whose results are published; its latency runs from the callback's start."""
        now = time.monotonic()
        self.health.done(now, now - self._callback_start)

    def problem(self, text: str) -> None:
        """Report a problem: once in the log, then counted; always the last error in the diagnostics."""
        line = self.health.problem(time.monotonic(), text)
        if line is not None:
            self.get_logger().error(line)

    def silence(self) -> str | None:
        """Why nothing has come out for a while, or None when all is well."""
        now = time.monotonic()
        if not self.active:
            return None
        since = self.health.last_output_time if self.health.last_output_time is not None else self.health.started
        if self.compiling or now - max(since, self._ready_at) < SILENCE_S:
            return None
        own = self.why_silent()
        if own is not None:
            return own
        if self._others_compiling():
            return None  # what is expected from them comes when they are ready
        other = self._other_transport()
        if other is not None:
            return other
        if self._sync is not None and self._sync.explain() is not None:
            return self._sync.explain()
        deaf = [topic for topic, count in self._received.items() if count == 0]
        if deaf:
            return f'nothing received on {", ".join(deaf)}'
        if self._received and self.health.last_error_time is not None and self.health.last_error_time >= since:
            return f'every input was refused: {self.health.last_error}'
        return f'no input for {now - since:.0f} s' if self._received else None

    def _other_transport(self) -> str | None:
        """Whether images that nobody sends raw are there compressed, or the other way round, and the remedy."""
        for topic, count in self._received.items():
            packed = topic.endswith(f'/{COMPRESSED}')
            other = topic.removesuffix(f'/{COMPRESSED}') if packed else f'{topic}/{COMPRESSED}'
            if count == 0 and not topic.endswith(INFO) and self.count_publishers(self._transported(other)):
                return (
                    f'nothing received on {topic}, but {other} is published: set image_transport to '
                    f'{RAW if packed else COMPRESSED}'
                )
        return None

    def _publish_diagnostics(self) -> None:
        self._on_prepared()  # should its guard condition have been overheard
        self._tell_compiling()
        now = time.monotonic()
        status = DiagnosticStatus(name=self.get_fully_qualified_name(), hardware_id='none', message='ok')
        silence, doubt = self.silence(), self.doubt()
        recent = self.health.last_error_time is not None and now - self.health.last_error_time < SILENCE_S
        if not self.active:
            status.message = f'{self.lifecycle}: {self.why_not}' if self.why_not else self.lifecycle
            status.level = DiagnosticStatus.WARN if self.why_not else DiagnosticStatus.OK
        elif silence is not None:
            status.level, status.message = DiagnosticStatus.WARN, silence
            if now - self._silence_logged >= SILENCE_LOG_S:
                self._silence_logged = now
                self.get_logger().warning(silence)
        elif self.compiling:
            status.message = f'compiling: {self.compiling}'
        elif recent:
            status.level, status.message = DiagnosticStatus.WARN, self.health.last_error
        elif doubt is not None:
            status.level, status.message = DiagnosticStatus.WARN, doubt
            self.get_logger().warning(doubt, throttle_duration_sec=REPEAT_LOG_S)
        elif self._old_names:
            status.level, status.message = DiagnosticStatus.WARN, '; '.join(self._old_names)
        elif self.health.processed == 0 and self._others_compiling():
            status.message = f'waiting: {self._others_compiling()}'
        values = self.health.values(now)
        if self._sync is not None:
            counters = self._sync.counters
            values |= {
                'stereo_pairs': counters.sets,
                'unmatched_stamps': counters.unmatched,
                'late_stamps': counters.late,
                'clock_jumps': counters.clock_jumps,
            }
        values |= {
            LIFECYCLE_KEY: self.lifecycle,
            COMPILING_KEY: self.compiling,
            'old_names_in_use': '; '.join(self._old_names),
            'ignored_parameters': ', '.join(self._ignored_overrides()),
        }
        values |= self.report_values()
        status.values = [KeyValue(key=str(key), value=str(value)) for key, value in values.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics_out.publish(message)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for sync in (self._sync, *self._optional_syncs):
            if sync is not None:
                sync.forget()
        self.health = Health(time.monotonic())
        self._newest.clear()
        try:
            response.success, response.message = True, f'reset: {self.reset() if self.configured else "counters"}'
        except Exception as error:
            response.success, response.message = False, f'{type(error).__name__}: {error}'
            self.problem(f'reset: {response.message}')
        return response


class _AlsoUnderOldNames:
    """A publisher that serves who still listens to the topic's old names, too."""

    def __init__(self, publisher: Publisher, former: dict[str, Publisher], warn: Callable[[str], None]) -> None:
        self._publisher, self._former, self._warn = publisher, former, warn

    def publish(self, message: Any) -> None:
        self._publisher.publish(message)
        for old, publisher in self._former.items():
            if publisher.get_subscription_count():
                self._warn(old)
                publisher.publish(message)

    def get_subscription_count(self) -> int:
        return sum(p.get_subscription_count() for p in (self._publisher, *self._former.values()))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._publisher, name)


def _of_message(callback: Callable[[Any], None]) -> Callable[[Any], None]:
    """A callback that is given the message of what is adapted."""

    def call(message: Any) -> None:
        callback(message.message if isinstance(message, Adapted) else message)

    return call


def spin_once(node: Node, executor: Executor, timeout_s: float | None = None) -> None:
    """One turn of the executor; what fails inside rclpy, outside of our guards (a malformed request), is reported.

    Parameters
    ----------
    node : rclpy.node.Node
        Whose log or diagnostics say it.
    executor : rclpy.executors.Executor
    timeout_s : float, optional
        Longest wait, seconds; without it, until something comes.
    """
    turn = node.inbox.turn if isinstance(node, GraphNode) else None
    try:
        if turn is None:
            executor.spin_once(timeout_sec=timeout_s)
        else:
            _spin_in_turn(executor, turn, timeout_s)
    except (KeyboardInterrupt, ExternalShutdownException):
        raise
    except Exception as error:
        text = f'{type(error).__name__}: {error}'
        node.problem(text) if isinstance(node, GraphNode) else node.get_logger().error(text)


def _spin_in_turn(executor: Executor, turn: threading.Lock, timeout_s: float | None) -> None:
    """As rclpy's spin_once; the turn is held while something is called, not while it is waited for."""
    try:
        handler, _, _ = executor.wait_for_ready_callbacks(timeout_s)
    except (TimeoutException, ShutdownException):
        return
    with turn:
        handler()
    handler.result()


class Running(Protocol):
    """What a process does until it is stopped."""

    @property
    def is_busy_compiling(self) -> bool:
        """Whether a thread compiles, also when it was closed."""

    def run(self) -> None:
        """Go on until the context is shut down; KeyboardInterrupt and ExternalShutdownException may end it."""

    def close(self) -> None:
        """End it."""


class _Spun:
    """A node and its executor."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(node)

    @property
    def is_busy_compiling(self) -> bool:
        return isinstance(self.node, GraphNode) and self.node.is_busy_compiling

    def run(self) -> None:
        while rclpy.ok():
            spin_once(self.node, self.executor)

    def close(self) -> None:
        self.node.destroy_node()


def run_node(factory: Callable[[], Node], args: list[str] | None = None) -> int:
    """Initialise, spin, and shut down cleanly on Ctrl-C, SIGTERM or an outside shutdown.

    Parameters
    ----------
    factory : callable
        Makes the node.
    args : list of str, optional
        Of the command; those of the process where it is left out.

    Returns
    -------
    int
        The exit code.
    """
    return run_until_stopped(lambda: _Spun(factory()), args)


def run_until_stopped(make: Callable[[], Running], args: list[str] | None = None, outlived: bool = False) -> int:
    """Initialise ROS, run, and shut down cleanly on Ctrl-C, SIGTERM or an outside shutdown.

    Parameters
    ----------
    make : callable
        Makes what runs.
    args : list of str, optional
        Of the command; those of the process where it is left out.
    outlived : bool
        Signals leave the context as it is, until what runs is closed. It must not wait for long outside of Python.

    Returns
    -------
    int
        The exit code.
    """
    make_room_for_images()
    try:
        if outlived:
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
            # What a shell runs in the background ignores SIGINT, unless it says otherwise.
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.default_int_handler)
        else:
            rclpy.init(args=args)
    except Exception as error:  # malformed --ros-args; rclpy has a type for each
        print(f'cannot start: {error}', file=sys.stderr)
        return 2
    running = None
    try:
        running = make()
        running.run()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        if running is not None:
            running.close()
        rclpy.try_shutdown()
    if running is not None and running.is_busy_compiling:
        # The compiler cannot be interrupted, and must not be while the interpreter is taken down around it.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)
    return 0
