"""Types of the arrays that functions take and return; shapes, units and frames stand in the docstrings.

Examples
--------
>>> import numpy as np
>>> def mean_point(points: FloatArray) -> FloatArray:
...     return points.mean(axis=0)
>>> mean_point(np.array([[0.0, 0.0], [1.0, 3.0]])).tolist()
[0.5, 1.5]
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]
# Indices and labels: of 32 bits in some records, of 64 where numpy makes them.
IntArray: TypeAlias = NDArray[np.signedinteger[Any]]
Int32Array: TypeAlias = NDArray[np.int32]
Int8Array: TypeAlias = NDArray[np.int8]
Int64Array: TypeAlias = NDArray[np.int64]
UInt16Array: TypeAlias = NDArray[np.uint16]
UInt32Array: TypeAlias = NDArray[np.uint32]
BoolArray: TypeAlias = NDArray[np.bool_]
ByteArray: TypeAlias = NDArray[np.uint8]
WordArray: TypeAlias = NDArray[np.uint64]
# Where an array may have any element type: pixels of several encodings, values of several kinds.
AnyArray: TypeAlias = NDArray[Any]
