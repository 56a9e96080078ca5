"""Numbers of command lines in their ranges."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable


def whole(least: int) -> Callable[[str], int]:
    """A parser of whole numbers from ``least`` on."""

    def parse(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f'expected a whole number >= {least}, got {value}')
        return value

    return parse


def number(least: float, most: float = math.inf, above: bool = False) -> Callable[[str], float]:
    """A parser of numbers in least..most, or with ``above`` greater than least."""
    wanted = f'> {least:g}' if above else f'in {least:g}..{most:g}' if most < math.inf else f'>= {least:g}'

    def parse(text: str) -> float:
        value = float(text)
        if not least <= value <= most or value == math.inf or (above and value == least):
            raise argparse.ArgumentTypeError(f'expected a number {wanted}, got {text}')
        return value

    return parse
