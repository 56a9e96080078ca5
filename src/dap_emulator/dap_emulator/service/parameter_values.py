"""Values of the services as rcl_interfaces/ParameterValue, the typed variant of ROS parameters, and back."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from rcl_interfaces.msg import ParameterType, ParameterValue

_FIELDS = {
    ParameterType.PARAMETER_BOOL: 'bool_value',
    ParameterType.PARAMETER_INTEGER: 'integer_value',
    ParameterType.PARAMETER_DOUBLE: 'double_value',
    ParameterType.PARAMETER_STRING: 'string_value',
    ParameterType.PARAMETER_BOOL_ARRAY: 'bool_array_value',
    ParameterType.PARAMETER_INTEGER_ARRAY: 'integer_array_value',
    ParameterType.PARAMETER_DOUBLE_ARRAY: 'double_array_value',
    ParameterType.PARAMETER_STRING_ARRAY: 'string_array_value',
}


def value_from_message(message: ParameterValue) -> Any:
    """Decode a typed variant.

    Parameters
    ----------
    message : ParameterValue

    Returns
    -------
    bool, int, float, str, list of str, or array of int64, float64 or bool

    Raises
    ------
    ValueError
        For a type that is not accepted.
    """
    if message.type not in _FIELDS:
        raise ValueError(f'type {message.type} is not accepted; use bool, integer, double, string or an array of them')
    value = getattr(message, _FIELDS[message.type])
    if isinstance(value, array.array):
        return np.array(value, dtype=np.int64 if value.typecode == 'q' else np.float64)
    if message.type == ParameterType.PARAMETER_BOOL_ARRAY:
        return np.array(value, dtype=bool)
    return list(value) if message.type == ParameterType.PARAMETER_STRING_ARRAY else value


def value_to_message(value: Any) -> ParameterValue:
    """Encode a value; None becomes a variant that is not set."""
    message = ParameterValue()
    if value is None:
        return message
    if isinstance(value, np.ndarray) and value.dtype.kind in 'iub':
        message.type = ParameterType.PARAMETER_INTEGER_ARRAY
        message.integer_array_value = array.array('q', value.astype(np.int64).tobytes())
        return message
    if isinstance(value, np.ndarray):
        message.type = ParameterType.PARAMETER_DOUBLE_ARRAY
        message.double_array_value = array.array('d', value.astype(np.float64).tobytes())
        return message
    kinds = {
        bool: ParameterType.PARAMETER_BOOL,
        int: ParameterType.PARAMETER_INTEGER,
        float: ParameterType.PARAMETER_DOUBLE,
        str: ParameterType.PARAMETER_STRING,
        list: ParameterType.PARAMETER_STRING_ARRAY,
    }
    message.type = kinds[type(value)]
    setattr(message, _FIELDS[message.type], value)
    return message
