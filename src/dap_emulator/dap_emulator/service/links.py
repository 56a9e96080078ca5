"""What carries a client's requests: the protocol, and a link to workspaces in the same process."""

from __future__ import annotations

import json
from typing import Any, Protocol

from ..fortran_plus.library import program_names, summary
from .workspaces import Refused, Workspaces


class DapError(RuntimeError):
    """The emulator refused a request, a program failed or was stopped, or no answer came. Its text says which."""


class Link(Protocol):
    """What carries a client's requests to an emulator."""

    def store(self, items: list[tuple[str, Any]]) -> str | None:
        """None, or the reason why nothing was stored."""

    def run(self) -> str: ...

    def fetch(self, names: list[str]) -> list[Any]: ...

    def list(self) -> str: ...

    def close(self) -> None: ...


class LocalLink:
    """A link to Workspaces in this process, without ROS."""

    def __init__(self, spaces: Workspaces) -> None:
        self.spaces = spaces

    def store(self, items: list[tuple[str, Any]]) -> str | None:
        try:
            self.spaces.store(items)
        except Refused as error:
            return str(error)
        return None

    def run(self) -> str:
        return json.dumps([request.summary() for request in self.spaces.execute_waiting()])

    def fetch(self, names: list[str]) -> list[Any]:
        return [self.spaces.fetch(name) for name in names]

    def list(self) -> str:
        return json.dumps({name: summary(name) for name in program_names()})

    def close(self) -> None:
        """Nothing to give back."""
