"""Emulator of the AMT DAP array processor: bit-plane machine, Fortran-Plus subset, cost model and ROS service node."""

from . import fortran_plus
from .machine import intrinsics
from .machine.arrays import DapArray
from .machine.costs import CONSTANTS, CostTable
from .machine.dap import Dap
from .machine.kinds import Kind
from .machine.machine import MODELS, Model, OutOfStore, Stats
from .machine.mapping import MAPPINGS, Layout
from .service.client import DapClient
from .service.links import DapError

__all__ = [
    'CONSTANTS',
    'CostTable',
    'Dap',
    'DapArray',
    'DapClient',
    'DapError',
    'Kind',
    'Layout',
    'MAPPINGS',
    'MODELS',
    'Model',
    'OutOfStore',
    'Stats',
    'fortran_plus',
    'intrinsics',
]
