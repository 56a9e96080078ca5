"""Nodes of one process that hand messages over to each other.

What comes over the network is taken once, however many of them listen, and what one of them publishes goes to the
others as it is, without being written and read again. Each node hears in turns of its own. A message that is handed
over is shared: nobody may change it. What nodes of the process publish is heard from them alone.
"""

from __future__ import annotations

import copy
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from .adapted import Adapted
from .inbox import Inbox
from .settings import QUEUE_DEPTH

# What a node is given of a message: itself, and what is known of its coming.
Take = Callable[[Any, dict[str, Any]], None]
# Seconds between two looks at whether the process ends.
LOOK_S = 0.2


class Taker:
    """A node's ear for a topic, in place of a subscription of its own.

    Parameters
    ----------
    topic : _Topic
    inbox : Inbox
        Of the node, in whose turn messages are taken.
    take : callable
    """

    def __init__(self, topic: _Topic, inbox: Inbox, take: Take) -> None:
        self.topic, self._inbox, self._take = topic, inbox, take
        self._queue: deque[tuple[Any, dict[str, Any]]] = deque(maxlen=QUEUE_DEPTH)

    @property
    def topic_name(self) -> str:
        """Fully qualified."""
        return self.topic.name

    def get_publisher_count(self) -> int:
        """As a subscription's."""
        outside = self.topic.outside
        return self.topic.inside + (0 if outside is None else outside.get_publisher_count())

    def put(self, message: Any, info: dict[str, Any]) -> None:
        """A message, from any thread; of more than a queue holds the oldest goes."""
        self._queue.append((message, info))
        self._inbox.put(self.take)

    def take(self) -> None:
        """Take the oldest, unless newer ones have pushed it out."""
        if self._queue:
            self._take(*self._queue.popleft())

    def close(self) -> None:
        """Hear nothing more."""
        self.topic.takers = [one for one in self.topic.takers if one is not self]
        self._queue.clear()


class _Topic:
    """Who hears a topic in this process, and whence it comes."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.takers: list[Taker] = []
        self.outside: Subscription | None = None
        self.inside = self.published = 0

    def put(self, message: Any, info: dict[str, Any]) -> None:
        """Hand a message over."""
        for taker in self.takers:
            taker.put(message, info)


class Handing:
    """A publisher that serves the nodes of its process directly, and the others when there are any.

    Parameters
    ----------
    publisher : rclpy.publisher.Publisher
    topic : _Topic
    """

    def __init__(self, publisher: Publisher, topic: _Topic) -> None:
        self.publisher, self._topic = publisher, topic

    def publish(self, message: Any) -> None:
        """As a publisher's; an Adapted reaches the nodes of the process as it is."""
        self._topic.published += 1
        self._topic.put(message, {'publication_sequence_number': self._topic.published})
        if self.publisher.get_subscription_count():
            self.publisher.publish(message.message if isinstance(message, Adapted) else message)

    def get_subscription_count(self) -> int:
        """As a publisher's, with the nodes of the process."""
        return len(self._topic.takers) + self.publisher.get_subscription_count()

    def close(self) -> None:
        """It is published no longer."""
        self._topic.inside -= 1

    def __getattr__(self, name: str) -> Any:
        return getattr(self.publisher, name)


class HandOver:
    """The topics that nodes of one process share.

    Parameters
    ----------
    context : rclpy.context.Context, optional
        Theirs; the default one without it.
    """

    def __init__(self, context: Context | None = None) -> None:
        self._context = context
        self._topics: dict[str, _Topic] = {}
        self._receiver: Node | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)

    @property
    def receivers(self) -> list[Node]:
        """What listens to the network in the nodes' place."""
        return [] if self._receiver is None else [self._receiver]

    def join(self, node: Node, overrides: list[Parameter]) -> None:
        """A node that shares topics.

        Parameters
        ----------
        node : rclpy.node.Node
        overrides : list of Parameter
            Given to it; those of QoS of the first node count for all.
        """
        if self._receiver is None:
            # Names were remapped by the nodes, so it remaps none.
            self._receiver = Node(
                f'{node.get_name()}_inputs',
                context=self._context,
                namespace=node.get_namespace(),
                use_global_arguments=False,
                start_parameter_services=False,
                enable_rosout=False,
                parameter_overrides=[one for one in overrides if one.name.startswith('qos_overrides.')],
            )
            self._thread.start()

    def listen(self, node: Node, inbox: Inbox, message_type: type, topic: str, take: Take, qos: QoSProfile) -> Taker:
        """A node's ear for a topic.

        Parameters
        ----------
        node : rclpy.node.Node
        inbox : Inbox
            The node's.
        message_type : type
        topic : str
            As the node calls it.
        take : callable
            Takes a message and what is known of its coming, in the node's turn.
        qos : rclpy.qos.QoSProfile
        """
        shared = self._topic(node, topic)
        taker = Taker(shared, inbox, take)
        shared.takers.append(taker)
        if shared.outside is None and not shared.inside and self._receiver is not None:
            shared.outside = self._receiver.create_subscription(
                message_type,
                shared.name,
                shared.put,  # type: ignore[arg-type]
                copy.copy(qos),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
        return taker

    def handing(self, node: Node, publisher: Publisher) -> Publisher:
        """The publisher of a node, which hands over what it publishes; what came from outside is heard no longer."""
        shared = self._topic(node, publisher.topic_name)
        shared.inside += 1
        if shared.outside is not None and self._receiver is not None:
            self._receiver.destroy_subscription(shared.outside)
            shared.outside = None
        return Handing(publisher, shared)  # type: ignore[return-value]

    def knows(self, parameter: str) -> bool:
        """Whether a parameter of QoS is that of a shared topic."""
        return self._receiver is not None and self._receiver.has_parameter(parameter)

    def close(self) -> None:
        """Take nothing more."""
        self._ended.set()
        if self._receiver is not None:
            self._thread.join(5.0)
            self._receiver.destroy_node()

    def _topic(self, node: Node, topic: str) -> _Topic:
        name = node.resolve_topic_name(topic)
        return self._topics.setdefault(name, _Topic(name))

    def _spin(self) -> None:
        executor = SingleThreadedExecutor(context=self._context)
        receiver = self._receiver
        assert receiver is not None
        executor.add_node(receiver)
        try:
            while not self._ended.is_set() and receiver.context.ok():
                executor.spin_once(timeout_sec=LOOK_S)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        finally:
            executor.shutdown()
