"""Fortran-Plus (Enhanced), the subset described in docs/dap.md: compile a source text and run it on a Dap."""

from .errors import FortranError, FortranStoreError, Stopped
from .program import Program, Result, compile
from .running import Limits

__all__ = ['FortranError', 'FortranStoreError', 'Limits', 'Program', 'Result', 'Stopped', 'compile']
