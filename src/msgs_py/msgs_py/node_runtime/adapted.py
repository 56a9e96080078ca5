"""Values that nodes of one process hand over as they are; a message is made of them when somebody asks for one.

What rclcpp calls type adaptation (REP 2007).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Generic, TypeVar

from std_msgs.msg import Header

Value = TypeVar('Value')


class Adapted(Generic[Value]):
    """A value in place of its message. It is shared: nobody may change it.

    Parameters
    ----------
    value : Value
    header : std_msgs.msg.Header
        Of the message.
    to_message : callable
        Makes the message of value and header.
    """

    def __init__(self, value: Value, header: Header, to_message: Callable[[Value, Header], Any]) -> None:
        self.value, self.header, self._to_message = value, header, to_message

    @cached_property
    def message(self) -> Any:
        """Its message, made once."""
        return self._to_message(self.value, self.header)
