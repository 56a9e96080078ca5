"""Watching a program: what every statement did, recorded, and made a page that a browser shows."""

from .page import write_page
from .recorder import Recorder

__all__ = ['Recorder', 'write_page']
