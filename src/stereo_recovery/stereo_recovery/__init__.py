"""Recovers 3D edges, curves and axes with stated uncertainty from a stereo pair."""

from .params import RecoveryParams
from .pipeline import Recovery, recover

__all__ = ['Recovery', 'RecoveryParams', 'recover']
