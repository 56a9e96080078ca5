"""The array machine's part of a closed-form test: Roberts' operator through the emulator's service."""

from __future__ import annotations

from typing import Any

import numpy as np

from dap_emulator import DapClient, DapError

# The thesis' first array program in spirit: one neighbour access and two differences for all pixels at once (3.7.1).
ROBERTS = """
      ENTRY SUBROUTINE ROBERTS(IMAGE, EDGE)
      INTEGER*2 IMAGE(,), EDGE(,)
      EDGE = ABS(IMAGE - IMAGE(+,+)) + ABS(IMAGE(+,) - IMAGE(,+))
      RETURN
      END
"""


def roberts_serial(image: np.ndarray) -> np.ndarray:
    """The same on a serial machine, int; beyond the last row and column lie zeros (planar geometry)."""
    padded = np.pad(np.asarray(image, dtype=np.int64), ((0, 1), (0, 1)))
    here, right, below, across = padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
    gradient: np.ndarray = np.abs(here - across) + np.abs(below - right)
    return gradient


def roberts_through_service(node: Any, executor: Any, emulator: str, image: np.ndarray) -> dict[str, Any]:
    """Store the middle 64 x 64 pixels and the program, run, fetch, compare with the serial answer.

    emulator : the emulator_node's fully qualified name. Returns the rows of the report's table.
    """
    top, left = (max(0, (size - 64) // 2) for size in image.shape)
    part = image[top : top + 64, left : left + 64].astype(np.int64)
    try:
        with DapClient(emulator, node=node, executor=executor) as client:
            result = client.run(ROBERTS, entry='ROBERTS', image=part, edge=np.zeros_like(part))
    except DapError as error:
        return {'program': 'Roberts operator', 'error': str(error)}
    return {
        'program': f'Roberts operator on {part.shape[0]} x {part.shape[1]} pixels of the left image',
        'machine': 'DAP 510 (computed, not simulated)',
        'cycles': int(result.cycles),
        'seconds on the machine': float(result.seconds),
        'pixels that differ from the serial answer': int((result['edge'] != roberts_serial(part)).sum()),
    }
