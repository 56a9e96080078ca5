"""What carries a client's requests: the protocol, and a link to workspaces in the same process."""

from __future__ import annotations

import json
from typing import Any, Protocol

from ..fortran_plus.library import program_names, summary
from .workspaces import Refused, Workspaces


class DapError(RuntimeError):
    """The emulator refused a request, a program failed or was stopped, or no answer came; the text gives the reason."""


class Link(Protocol):
    """What carries a client's requests to an emulator."""

    def store(self, items: list[tuple[str, Any]]) -> str | None:
        """Store names and values; return None, or the reason why nothing was stored."""

    def run(self) -> str:
        """Execute what waits; return its summaries as JSON text."""

    def fetch(self, names: list[str]) -> list[Any]:
        """Read the values of names; None where there is none."""

    def list(self) -> str:
        """Return the library's programs, name to summary, as JSON text."""

    def close(self) -> None:
        """Give back what the link holds."""


class LocalLink:
    """A link to workspaces in this process, without ROS.

    Parameters
    ----------
    spaces : Workspaces
    """

    def __init__(self, spaces: Workspaces) -> None:
        self.spaces = spaces

    def store(self, items: list[tuple[str, Any]]) -> str | None:
        """Store names and values; return None, or the reason why nothing was stored."""
        try:
            self.spaces.store(items)
        except Refused as error:
            return str(error)
        return None

    def run(self) -> str:
        """Execute what waits; return its summaries as JSON text."""
        return json.dumps([request.summary() for request in self.spaces.execute_waiting()])

    def fetch(self, names: list[str]) -> list[Any]:
        """Read the values of names; None where there is none."""
        return [self.spaces.fetch(name) for name in names]

    def list(self) -> str:
        """Return the library's programs, name to summary, as JSON text."""
        return json.dumps({name: summary(name) for name in program_names()})

    def close(self) -> None:
        """Nothing to give back."""
