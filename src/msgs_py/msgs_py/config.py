"""Parameters as frozen dataclasses, under the name that users know."""

from .node_runtime.config import Config, ParameterSpec, T, parameter

__all__ = ['Config', 'ParameterSpec', 'T', 'parameter']
