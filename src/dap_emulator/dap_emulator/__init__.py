"""Emulator of the AMT DAP array processor: bit-plane machine, Fortran-Plus subset, cost model and ROS service node."""

from . import fortran_plus, intrinsics
from .arrays import DapArray
from .client import DapClient
from .costs import CONSTANTS, CostTable
from .kinds import Kind
from .machine import MODELS, Dap, Model, OutOfStore, Stats
from .mapping import MAPPINGS, Layout

__all__ = ['CONSTANTS', 'CostTable', 'Dap', 'DapArray', 'DapClient', 'Kind', 'Layout', 'MAPPINGS', 'MODELS', 'Model',
           'OutOfStore', 'Stats', 'fortran_plus', 'intrinsics']
