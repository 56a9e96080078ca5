"""Draws the pictures of the scenes carton and printed_goods: six printed sides, a label, and a studio around them.

python test/docs/carton.py [FOLDER]      # default: the scenes of csg_renderer
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

MODELS = Path(__file__).resolve().parents[2] / 'src' / 'csg_renderer' / 'csg_renderer' / 'models'
# Width, depth and height of the carton, mm, and pixels a millimetre of its print.
SIZE = (120, 80, 60)
SCALE = 4
# Pixels of one of the six pictures of its file, which is stretched over a side.
CELL = (480, 320)
KRAFT, INK, RED, BLUE, WHITE = (98, 146, 186), (40, 36, 34), (44, 44, 190), (140, 84, 30), (244, 246, 246)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog='carton', description=__doc__.splitlines()[0])
    parser.add_argument('folder', type=Path, nargs='?', default=MODELS, help='where the pictures go')
    options = parser.parse_args(arguments)
    for name, picture in (('carton', carton()), ('label', label()), ('studio', studio())):
        cv2.imwrite(str(options.folder / f'{name}.png'), picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return 0


def carton() -> np.ndarray:
    """(640, 1440, 3) uint8: +x, +y, +z above -x, -y, -z."""
    width, depth, height = SIZE
    end, front, top, bottom = (
        paper(across, up) for across, up in ((depth, height), (width, height), (width, depth), (width, depth))
    )
    for side in (front, top):
        cv2.rectangle(side, (0, side.shape[0] * 3 // 5), (side.shape[1], side.shape[0] * 4 // 5), BLUE, -1)
        write(side, 'HEXAGON BOLTS', (26, side.shape[0] * 3 // 5 + 36), 1.05, WHITE, 3)
    write(front, 'M8 x 40', (26, 74), 1.7, INK, 5)
    write(top, 'M8 x 40', (26, 90), 2.0, INK, 6)
    hexagon(front, (400, 68), 48)
    hexagon(top, (392, 96), 66)
    barcode(end, (26, 30), (150, 110))
    write(end, 'LOT 1993-07', (26, 176), 0.75, INK, 2)
    for x in (205, 260):
        cv2.arrowedLine(end, (x, 130), (x, 30), RED, 8, cv2.LINE_AA, tipLength=0.4)
    cv2.line(end, (190, 144), (276, 144), RED, 8)
    back = front.copy()
    back[:150] = paper(width, height)[:150]
    write(back, '100 pcs  8.8', (26, 74), 1.4, INK, 4)
    cv2.line(bottom, (0, bottom.shape[0] // 2), (bottom.shape[1], bottom.shape[0] // 2), (76, 120, 160), 20)
    cells = [cv2.resize(side, CELL, interpolation=cv2.INTER_AREA) for side in (end, back, top, end, front, bottom)]
    return np.vstack([np.hstack(cells[:3]), np.hstack(cells[3:])])


def paper(across: int, up: int) -> np.ndarray:
    """A side of so many millimetres, brown with a tape along its edges."""
    side = np.full((up * SCALE, across * SCALE, 3), KRAFT, dtype=np.uint8)
    cv2.rectangle(side, (6, 6), (side.shape[1] - 7, side.shape[0] - 7), (84, 130, 170), 2)
    return side


def write(side: np.ndarray, text: str, at: tuple[int, int], size: float, colour: tuple, width: int) -> None:
    cv2.putText(side, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, width, cv2.LINE_AA)


def hexagon(side: np.ndarray, at: tuple[int, int], radius: int) -> None:
    """A bolt's head."""
    angles = np.arange(6) * np.pi / 3
    corners = np.stack([at[0] + radius * np.cos(angles), at[1] + radius * np.sin(angles)], axis=1)
    cv2.fillPoly(side, [np.rint(corners).astype(np.int32)], RED, cv2.LINE_AA)
    cv2.circle(side, at, radius // 2, KRAFT, -1, cv2.LINE_AA)


def barcode(side: np.ndarray, at: tuple[int, int], size: tuple[int, int]) -> None:
    """Bars of a few widths on white."""
    (x, y), (width, height) = at, size
    cv2.rectangle(side, (x - 8, y - 8), (x + width + 8, y + height + 8), WHITE, -1)
    random = np.random.default_rng(7)
    end = x + width
    while x < end - 6:
        bar, gap = random.integers(2, 7, 2)
        side[y : y + height, x : min(x + bar, end)] = INK
        x += int(bar + gap)


def label() -> np.ndarray:
    """(160, 640, 3) uint8: what goes around a can."""
    picture = np.full((160, 640, 3), WHITE, dtype=np.uint8)
    picture[:22], picture[-22:] = RED, RED
    for x in (60, 380):
        write(picture, 'GREASE', (x, 84), 1.4, BLUE, 5)
        write(picture, 'for bearings  250 g', (x, 122), 0.65, INK, 2)
    barcode(picture, (300, 50), (60, 60))
    return picture


def studio() -> np.ndarray:
    """(64, 128) uint8: a dim room with a window of light above, two beside, and a grey floor."""
    rows = np.linspace(0.0, 1.0, 64)[:, None]
    room = np.where(rows < 0.5, 54.0 - 24.0 * rows, 30.0) * np.ones((1, 128))
    room[6:20, 44:84] = 255.0
    room[18:34, 8:22] = 235.0
    room[14:34, 100:108] = 200.0
    return np.rint(cv2.GaussianBlur(room, (0, 0), 0.8)).astype(np.uint8)


if __name__ == '__main__':
    sys.exit(main())
