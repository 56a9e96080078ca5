"""Stated chances held against observed ones: the table and the picture of a calibration (a reliability diagram).

A search for what is not there says with what chance it would have brought so much evidence. If that is true, one in a
hundred of such searches says 0.01 or less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.stats import beta

RATES = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
# Rates at which the share of refused objects is told.
REFUSED_AT = (0.1, 0.01, 0.001)
# Ends of an interval that holds 90 in 100.
INTERVAL = (0.05, 0.95)
COLOURS = (
    (0, 0, 0),
    (200, 80, 0),
    (0, 140, 0),
    (0, 0, 220),
    (190, 0, 190),
    (160, 160, 0),
    (0, 140, 255),
    (120, 120, 120),
    (90, 40, 130),
    (60, 180, 120),
)


@dataclass(frozen=True)
class Stated:
    """A search and the chance that it states.

    kind : what the scene is made of; share : of the object in view, 0 where it is not there; chance : that so much
    evidence is no more than chance, of an object that is there that of its right pose, 1 where none was thought of
    """

    kind: str
    share: float
    chance: float


def figures(searches: Sequence[Stated]) -> dict[str, dict[str, float]]:
    """By kind, and of 'all': absent, and false alarms of a thousand at each of RATES; shares of refused objects."""
    found = {}
    for kind in (*dict.fromkeys(one.kind for one in searches), 'all'):
        some = [one for one in searches if kind in (one.kind, 'all')]
        absent = np.array([one.chance for one in some if one.share == 0.0])
        row: dict[str, float] = {'absent': len(absent)}
        for rate in RATES:
            reached = int((absent <= rate).sum())
            row[f'{rate:g}'] = 1e3 * reached / max(len(absent), 1)
            row[f'{rate:g} low'], row[f'{rate:g} high'] = (1e3 * end for end in bounds(reached, len(absent)))
        for share in sorted({one.share for one in some if one.share > 0.0}, reverse=True):
            there = np.array([one.chance for one in some if one.share == share])
            row[f'{share:g} there'] = len(there)
            for rate in REFUSED_AT:
                row[f'{share:g} refused at {rate:g}'] = float((there > rate).mean())
        found[kind] = row
    return found


def bounds(count: int, of: int) -> tuple[float, float]:
    """What the share is that brings so many, with 90 in 100 certainty (Clopper and Pearson)."""
    low = float(beta.ppf(INTERVAL[0], count, of - count + 1)) if count else 0.0
    high = float(beta.ppf(INTERVAL[1], count + 1, of - count)) if count < of else 1.0
    return low, high


def within(row: dict[str, float], factor: float = 2.0) -> list[str]:
    """The rates that are off by more than a factor beyond what so few searches leave open: '0.1 (0.28)'."""
    off = []
    for rate in RATES:
        name = f'{rate:g}'
        if row[f'{name} low'] > factor * 1e3 * rate or row[f'{name} high'] < 1e3 * rate / factor:
            off.append(f'{name} ({row[name] / 1e3:.2g})')
    return off


def lines(rows: dict[str, dict[str, float]]) -> list[str]:
    """The table as text: false alarms of a thousand searches at each rate, and the shares of refused objects."""
    width = max(len(kind) for kind in rows)
    text = [f'{"":<{width}}  absent' + ''.join(f'{f"at {rate:g}":>9}' for rate in RATES) + '   off by more than 2']
    for kind, row in rows.items():
        cells = ''.join(f'{row[f"{rate:g}"]:9.1f}' for rate in RATES)
        text.append(f'{kind:<{width}}{row["absent"]:8.0f}{cells}   {", ".join(within(row)) or "-"}')
    for kind, row in rows.items():
        shares = [name.removesuffix(' there') for name in row if name.endswith(' there')]
        for share in shares:
            cells = ', '.join(f'{100 * row[f"{share} refused at {rate:g}"]:.1f} % at {rate:g}' for rate in REFUSED_AT)
            there = f'{row[f"{share} there"]:.0f} there, {100 * float(share):.0f} % in view'
            text.append(f'{kind:<{width}}  {there}: refused {cells}')
    return text


def drawing(searches: Sequence[Stated], title: str) -> np.ndarray:
    """Observed shares over stated chances, from 1 to 0.001, both logarithmic; a line a kind, grey within a factor of 2.

    uint8 image.
    """
    side, left, top, decades = 480, 70, 40, 3.0
    image = np.full((side + top + 50, side + left + 260, 3), 255, np.uint8)

    def at(stated: float, observed: float) -> tuple[int, int]:
        x, y = (min(-np.log10(max(value, 1e-9)) / decades, 1.0) for value in (stated, observed))
        return round(left + side * (1.0 - x)), round(top + side * y)

    least = 10.0**-decades
    band = [at(1.0, 1.0), at(0.5, 1.0), at(least, 2.0 * least), at(least, least), at(2 * least, least), at(1.0, 0.5)]
    cv2.fillPoly(image, [np.array(band)], (235, 235, 235))
    for step in range(int(decades) + 1):
        value = 10.0**-step
        cv2.line(image, at(value, 1.0), at(value, least), (210, 210, 210), 1)
        cv2.line(image, at(1.0, value), at(least, value), (210, 210, 210), 1)
        _write(image, f'{value:g}', (at(value, 1.0)[0] - 12, top + side + 18))
        _write(image, f'{value:g}', (18, at(1.0, value)[1] + 5))
    cv2.line(image, at(1.0, 1.0), at(least, least), (150, 150, 150), 1, cv2.LINE_AA)
    _write(image, f'{title}: share of searches for what is not there, over the chance they state', (left, 22))
    _write(image, 'stated', (left + side // 2, top + side + 40))
    for number, kind in enumerate(dict.fromkeys(one.kind for one in searches)):
        chances = np.sort([one.chance for one in searches if one.kind == kind and one.share == 0.0])
        colour = COLOURS[number % len(COLOURS)]
        y = top + 20 + 20 * number
        cv2.line(image, (left + side + 15, y), (left + side + 45, y), colour, 2, cv2.LINE_AA)
        _write(image, f'{kind} ({len(chances)})', (left + side + 52, y + 4))
        stated = np.logspace(-decades, 0.0, 121)
        observed = np.searchsorted(chances, stated, side='right') / max(len(chances), 1)
        seen = observed > 0.0
        points = np.array([at(s, o) for s, o in zip(stated[seen], observed[seen])]).reshape(-1, 1, 2)
        cv2.polylines(image, [points], False, colour, 2, cv2.LINE_AA)
    return image


def _write(image: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
