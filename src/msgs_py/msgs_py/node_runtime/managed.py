"""A node with the managed life of ROS: unconfigured, inactive, active, finalized (design.ros2.org, node lifecycle).

It configures and activates itself when it is made, so that to run it is enough; with the parameter ``autostart`` false
it waits for a manager, or for ``ros2 lifecycle set``. What a node says of its own life, and how its resources go with
it, stands here; what it does stands in its four hooks.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.timer import Timer

AUTOSTART = 'autostart'
UNCONFIGURED, INACTIVE, ACTIVE = 'unconfigured', 'inactive', 'active'
# States, and what lies between them, in which a node has its inputs, and its outputs.
WORKING = (ACTIVE, 'activating')
LOADED = (*WORKING, INACTIVE, 'configuring', 'deactivating')
# Whatever a transition brings.
DONE = TransitionCallbackReturn.SUCCESS


class ManagedNode(LifecycleNodeMixin, Node):
    """A node whose outputs live from configure to cleanup, and whose inputs and timers from activate to deactivate.

    Parameters
    ----------
    name : str
    **kwargs
        For rclpy's Node.

    Attributes
    ----------
    why_not : str
        Why it could not be configured; empty when it was, or was not asked to.
    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        Node.__init__(self, name, **kwargs)
        # Of a group of its own: a manager that waits for the compiler keeps no other callback waiting.
        LifecycleNodeMixin.__init__(self, callback_group=ReentrantCallbackGroup())
        self.why_not = ''
        self._starting = False
        self._inputs: list[Any] = []  # subscriptions, or what stands for them
        self._outputs_made: list[Publisher] = []
        self._timers_running: list[Timer] = []
        # rclpy lets what the state machine refuses escape from the service, so that nobody is answered.
        service = self._service_change_state
        self._change_state: Callable[[Any, Any], Any] = service.callback
        service.callback = self._on_change_state  # type: ignore[assignment]

    # -- to be overridden --------------------------------------------------------------------------------------

    def configure(self) -> None:
        """Make outputs, load what parameters name, and begin to compile; raise ValueError when that cannot be."""

    def activate(self) -> None:
        """Subscribe, and start timers."""

    def deactivate(self) -> None:
        """End what is under way; subscriptions and timers go by themselves."""

    def cleanup(self) -> None:
        """Forget what was loaded; outputs go by themselves."""

    def unusable(self) -> str:
        """Why the node, configured, would be of no use; empty when it is of some.

        A manager is refused then. A node that starts itself goes on, for what is missing may come.
        """
        return ''

    def problem(self, text: str) -> None:
        """Report a problem."""
        self.get_logger().error(text)

    async def prepared(self) -> None:
        """Until all is compiled."""

    # -- its life ----------------------------------------------------------------------------------------------

    @property
    def lifecycle(self) -> str:
        """The state it is in."""
        return str(self._state_machine.current_state[1])

    @property
    def active(self) -> bool:
        """Whether it works."""
        return self.lifecycle in WORKING

    @property
    def configured(self) -> bool:
        """Whether it has its outputs and what it loads."""
        return self.lifecycle in LOADED

    def start(self) -> None:
        """Configure and activate, unless the parameter autostart is false: the last line of a node's constructor."""
        if not self._declare_autostart():
            return
        self._starting = True
        try:
            self.trigger_configure()
            if self.lifecycle == INACTIVE:
                self.trigger_activate()
        finally:
            self._starting = False

    def _declare_autostart(self) -> bool:
        descriptor = ParameterDescriptor(
            description='Configure and activate at the start; otherwise a manager does, or ros2 lifecycle set',
            read_only=True,
        )
        try:
            return bool(self.declare_parameter(AUTOSTART, True, descriptor).value)
        except InvalidParameterTypeException as error:
            self.problem(f'{error}; using the default True')
            return bool(self.declare_parameter(AUTOSTART, True, descriptor, ignore_override=True).value)

    async def _on_change_state(self, request: Any, response: Any) -> Any:
        """A transition that is asked for. What is configured answers when it is compiled, too."""
        asked = request.transition.label or request.transition.id
        offered = [one[:2] for one in self._state_machine.available_transitions]
        if not any(asked in one for one in offered):
            labels = ', '.join(label for _, label in offered)
            self.problem(f'lifecycle: {asked} is not possible when {self.lifecycle}, expected one of {labels}')
            response.success = False
            return response
        response = self._change_state(request, response)
        if response.success and self.lifecycle == INACTIVE:
            await self.prepared()
        return response

    def _try(self, hook: Callable[[], None]) -> str:
        """Call a hook; what it raises, in words."""
        try:
            hook()
        except ValueError as error:
            return str(error)
        except Exception as error:  # a fault of ours must not take the robot's node down
            self.get_logger().debug(traceback.format_exc())
            return f'{type(error).__name__}: {error}'
        return ''

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As rclpy's, from unconfigured to inactive."""
        self.why_not = self._try(self.configure)
        refused = self.why_not or self.unusable()
        if not refused or (self._starting and not self.why_not):
            return super().on_configure(state)
        self._forget()
        self.why_not = refused
        self.problem(f'cannot be configured: {refused}')
        return TransitionCallbackReturn.FAILURE

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As rclpy's, from inactive to active."""
        reason = self._try(self.activate)
        if not reason:
            return super().on_activate(state)
        self._quiet()
        self.problem(f'cannot be activated: {reason}')
        return TransitionCallbackReturn.FAILURE

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As rclpy's, from active to inactive."""
        self._quiet()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As rclpy's, from inactive to unconfigured."""
        self._forget()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As rclpy's, from any of them to finalized."""
        if state.label == ACTIVE:
            self._quiet()
        if state.label != UNCONFIGURED:
            self._forget()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As rclpy's: what went wrong was reported, and the node can be configured again."""
        self._quiet()
        self._forget()
        return DONE

    def _quiet(self) -> None:
        """Hear nothing more, and end what is under way."""
        for subscription in self._inputs:
            self.destroy_subscription(subscription)
        for timer in self._timers_running:
            self.destroy_timer(timer)
        self._inputs, self._timers_running = [], []
        self._report(self._try(self.deactivate))

    def _forget(self) -> None:
        """Give back what configuring has taken."""
        for publisher in self._outputs_made:
            self.destroy_publisher(publisher)
        self._outputs_made = []
        self._report(self._try(self.cleanup))

    def _report(self, text: str) -> None:
        if text:
            self.problem(text)

    # -- what goes with it -------------------------------------------------------------------------------------

    def owned(self, publisher: Publisher) -> Publisher:
        """A publisher that goes with cleanup."""
        self._outputs_made.append(publisher)
        return publisher

    def every(self, seconds: float, callback: Callable[[], None], **kwargs: Any) -> Timer:
        """A timer that goes with deactivate; further arguments as for create_timer."""
        timer = self.create_timer(seconds, callback, **kwargs)
        self._timers_running.append(timer)
        return timer
