"""Makes the heights of the scene hills: an island with a crater, from a few waves and bells.

python test/docs/hills.py [FILE]      # default: hills.png among the scenes of csg_renderer
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

MODELS = Path(__file__).resolve().parents[2] / 'src' / 'csg_renderer' / 'csg_renderer' / 'models'
SIDE = 97


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog='hills', description=__doc__.splitlines()[0])
    parser.add_argument('file', type=Path, nargs='?', default=MODELS / 'hills.png', help='16-bit grey PNG to write')
    options = parser.parse_args(arguments)
    cv2.imwrite(str(options.file), np.rint(65535 * heights(SIDE)).astype(np.uint16))
    return 0


def heights(side: int) -> np.ndarray:
    """(side, side) float64, 0..1: row 0 is the far side."""
    random = np.random.default_rng(4)
    y, x = np.mgrid[1.0 : -1.0 : side * 1j, -1.0 : 1.0 : side * 1j]
    rough = np.zeros_like(x)
    for octave in range(1, 6):
        for _ in range(6):
            kx, ky = random.normal(size=2) * 1.6**octave
            rough += 1.9**-octave * np.sin(kx * x + ky * y + random.uniform(0.0, 2.0 * np.pi))
    mountain = 1.25 * np.exp(-((x + 0.25) ** 2 + (y - 0.3) ** 2) / 0.12)
    crater = 1.15 * np.exp(-((x + 0.25) ** 2 + (y - 0.3) ** 2) / 0.02)
    ridge = 0.45 * np.exp(-((x - 0.45 - 0.3 * y) ** 2) / 0.04 - (y - 0.1) ** 2 / 0.3)
    coast = np.clip(1.35 - 1.25 * (x**4 + y**4) - 0.75 * (x**2 + y**2), -0.5, 1.0)
    land = 0.35 * coast + mountain - crater + ridge + 0.2 * rough * (0.25 + np.clip(coast, 0.0, 1.0))
    return np.asarray((land - land.min()) / np.ptp(land))


if __name__ == '__main__':
    sys.exit(main())
