"""Draws the factor graph of straight edges for the page of the method: a block, its edges, and what ties them."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from stereo_recovery.estimation import settings
from stereo_recovery.matching.settings import SEEN_AS_ONE

INK, PALE = '#333333', '#c8ccd0'
JUNCTION, ROUNDED, END = '#2471a3', '#8e44ad', '#e67e22'
GROUPS = ('#27ae60', '#c0392b', '#16a085')
# A block as the left eye shows it, and an edge that passes behind it: where each begins and ends, and what group it is
# of.
EDGES = {
    1: ((1.0, 4.0), (5.0, 4.0), 0),
    2: ((1.1, 0.9), (1.0, 4.0), 1),
    3: ((4.9, 0.6), (5.0, 4.0), 1),
    4: ((1.1, 0.9), (4.9, 0.6), 0),
    5: ((1.0, 4.0), (2.9, 5.7), 2),
    6: ((2.9, 5.7), (6.9, 5.8), 0),
    7: ((5.0, 4.0), (6.9, 5.8), 2),
    8: ((6.85, 5.2), (6.7, 2.6), 1),
    9: ((4.9, 0.6), (6.7, 2.6), 2),
    10: ((-1.9, 2.1), (1.08, 1.6), None),
}
# Pairs that meet, and where.
JUNCTIONS = (
    (1, 2, (1.0, 4.0)),
    (1, 5, (1.0, 4.0)),
    (1, 3, (5.0, 4.0)),
    (3, 7, (5.0, 4.0)),
    (2, 4, (1.1, 0.9)),
    (3, 4, (4.9, 0.6)),
    (3, 9, (4.9, 0.6)),
    (5, 6, (2.9, 5.7)),
    (6, 7, (6.9, 5.8)),
    (8, 9, (6.7, 2.6)),
)
ROUNDED_CORNER = (7, 8, (6.9, 5.8))
ACCIDENT = (2, 10, (1.08, 1.6))
LOOSE_END = 10
# What the lines of level edges say of themselves is next to nothing.
LEVEL = (1, 4, 6, 10)


def middle(edge: int) -> np.ndarray:
    """(2,) where the edge's unknowns are drawn."""
    return np.mean(EDGES[edge][:2], axis=0)


def factor(axes, place, colour: str, marker: str = 's', filled: bool = True, size: float = 9) -> None:
    axes.plot(*place, marker, ms=size, mfc=colour if filled else 'white', mec=colour, mew=1.6, zorder=4)


def link(axes, start, end, colour: str, style: str = '-') -> None:
    axes.plot(*np.transpose([start, end]), style, color=colour, lw=1.4, zorder=2)


def tie(axes, pair: tuple[int, int, tuple[float, float]], colour: str, holds: bool = True) -> None:
    """A factor of two edges, drawn near the corner where they meet."""
    first, second, corner = pair
    between = 0.5 * (middle(first) + middle(second))
    place = 0.42 * between + 0.58 * np.array(corner)
    for edge in (first, second):
        link(axes, middle(edge), place, colour, '-' if holds else ':')
    factor(axes, place, colour, filled=holds)


def hang(axes, edge: int, turn: float, colour: str, marker: str, filled: bool = True) -> None:
    """A factor of one edge, beside it."""
    place = middle(edge) + 0.52 * np.array([np.cos(turn), np.sin(turn)])
    link(axes, middle(edge), place, colour)
    factor(axes, place, colour, marker, filled, 7)


def graph(axes) -> None:
    for start, end, _ in EDGES.values():
        link(axes, start, end, PALE)
    for pair in JUNCTIONS:
        tie(axes, pair, JUNCTION)
    tie(axes, ROUNDED_CORNER, ROUNDED)
    tie(axes, ACCIDENT, JUNCTION, holds=False)
    loose = EDGES[LOOSE_END][0]
    link(axes, middle(LOOSE_END), loose, END)
    factor(axes, loose, END)
    for edge, (start, end, group) in EDGES.items():
        along = np.arctan2(end[1] - start[1], end[0] - start[0])
        hang(axes, edge, along + 0.5 * np.pi, INK, 'o', edge not in LEVEL)
        if group is not None:
            hang(axes, edge, along - 0.5 * np.pi, GROUPS[group], 'D')
        axes.plot(*middle(edge), 'o', ms=21, mfc='white', mec=INK, mew=1.5, zorder=5)
        axes.text(*middle(edge), f'$x_{{{edge}}}$', ha='center', va='center', fontsize=10, color=INK, zorder=6)
    legend = (
        (INK, 'o', True, 'own lines'),
        (INK, 'o', False, 'own lines, next to nothing: along the rows'),
        (JUNCTION, 's', True, 'junction'),
        (JUNCTION, 's', False, 'junction that does not hold: an accident'),
        (ROUNDED, 's', True, 'rounded corner'),
        (END, 's', True, 'end'),
        (GROUPS[1], 'D', True, 'parallel group, one colour each'),
    )
    for k, (colour, marker, filled, text) in enumerate(legend):
        at = np.array([-1.9 + 6.0 * (k // 4), -0.4 - 0.42 * (k % 4)])
        factor(axes, at, colour, marker, filled, 8)
        axes.text(*(at + [0.25, 0.0]), text, va='center', fontsize=9, color=INK)
    axes.set_title('Edges that the left eye sees, and what ties their unknowns')
    axes.set_aspect('equal')
    axes.axis('off')


def holds(residual: np.ndarray, prior: float, predicted: float) -> np.ndarray:
    """Probability that a junction holds: residual and sigma of what the others predict in pixels."""
    variance = predicted**2 + settings.CORNER_SIGMA**2
    inlier = prior * np.exp(-0.5 * residual**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    outlier = (1.0 - prior) / np.hypot(settings.SPREAD, np.sqrt(2.0 * np.pi) * predicted)
    return np.asarray(inlier / (inlier + outlier))


def mixture(axes) -> None:
    residual = np.linspace(0.0, 6.0, 1200)
    for prior, name, colour in (
        (settings.JUNCTION_PRIOR, 'met in both images', JUNCTION),
        (SEEN_AS_ONE, 'loose in the other', END),
        (settings.T_PRIOR, 'one goes on beyond', GROUPS[1]),
    ):
        for predicted, style in ((0.05, '-'), (0.3, '--'), (1.0, ':')):
            label = f'{name}, prior {prior:g}' if style == '-' else None
            axes.plot(residual, holds(residual, prior, predicted), style, color=colour, label=label)
    for predicted, style in ((0.05, '-'), (0.3, '--'), (1.0, ':')):
        axes.plot([], [], style, color=INK, label=f'the others know it to {predicted:g} px')
    axes.axhline(0.5, color=PALE, lw=1, zorder=0)
    axes.set_xlim(0.0, 6.0)
    axes.set_ylim(0.0, 1.02)
    axes.set_xlabel('miss from what all others say [px]')
    axes.set_ylabel('probability that the junction holds')
    axes.legend(fontsize=8, frameon=False, loc='upper right')
    axes.spines[['top', 'right']].set_visible(False)
    axes.set_title('What becomes of a junction')


def draw(path: Path) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(13, 5.8), gridspec_kw={'width_ratios': (1.6, 1)})
    graph(axes[0])
    mixture(axes[1])
    figure.tight_layout()
    figure.savefig(path, dpi=100)
    plt.close(figure)
