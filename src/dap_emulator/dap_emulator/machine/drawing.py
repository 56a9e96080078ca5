"""Pictures of arrays as the grid of PEs: PNG, animated GIF, and small pictures for notebooks.

Imports matplotlib, which takes about a second: imported only by what draws, when it draws.
"""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import matplotlib
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from msgs_py.numeric.typed import AnyArray

from .settings import DOTS_PER_INCH, FINE_GRID, FRAMES_IN_A_STRIP, FRAMES_PER_SECOND, NOTEBOOK_PIXELS

SUFFIXES = ('.png', '.gif')
# The name of an array, its values, and a title such as CALL DISPLAY gives.
DrawnFrame: TypeAlias = tuple[str, AnyArray, str]


class _Scale(NamedTuple):
    """Shared by all frames of a picture: PEs along an edge, values drawn darkest and lightest, number of frames."""

    es: int
    low: float
    high: float
    frames: int


def grid_of(values: AnyArray, es: int) -> AnyArray:
    """An array as rows and columns of a picture.

    Parameters
    ----------
    values : (rows, columns) or (n,) array
    es : int
        PEs along an edge of the array of PEs.

    Returns
    -------
    (rows, columns) array
        A matrix as it is; a vector folded down the columns of ES x ES blocks, blocks side by side.

    Raises
    ------
    ValueError
        For more than two dimensions.
    """
    values = np.asarray(values)
    if values.ndim == 2:
        return values
    if values.ndim > 2:
        raise ValueError(f'show: expected a vector or matrix, got {values.ndim} dimensions; index the serial ones')
    flat = np.atleast_1d(values)
    columns = -(-len(flat) // es)
    # Whole columns, so that a short vector is shown as one strip.
    padded = np.zeros(columns * es, dtype=flat.dtype)
    padded[: len(flat)] = flat
    return padded.reshape(columns, es).T[: min(es, len(flat))]


def draw(frames: Sequence[DrawnFrame], path: str | Path, es: int = 32) -> None:
    """Write frames to a picture: a PNG of the last with a strip of earlier ones, or an animated GIF of all.

    Parameters
    ----------
    frames : sequence of (name, values, title)
    path : str or Path
        Ends in .png or .gif.
    es : int
        PEs along an edge: red lines are drawn where blocks of ES x ES elements meet.

    Raises
    ------
    ValueError
        For another suffix, no frames, or an array of more than two dimensions.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f'show: expected a file name ending in {" or ".join(SUFFIXES)}, got {path.name!r}')
    if not frames:
        raise ValueError('show: there is nothing to draw')
    grids = [grid_of(values, es) for _, values, _ in frames]
    scale = _Scale(es, *_range(grids), len(frames))
    if path.suffix.lower() == '.png':
        _draw_strip(frames, grids, scale, path)
    else:
        _draw_animation(frames, grids, scale, path)


def _draw_strip(frames: Sequence[DrawnFrame], grids: Sequence[AnyArray], scale: _Scale, path: Path) -> None:
    """A PNG with the last frame and some of the earlier ones side by side."""
    chosen = _spread(len(frames), FRAMES_IN_A_STRIP)
    figure = Figure(figsize=(1.0 + 3.6 * len(chosen), 4.2), layout='constrained')
    FigureCanvasAgg(figure)
    for place, index in enumerate(chosen):
        axes = figure.add_subplot(1, len(chosen), place + 1)
        _draw_one(axes, frames[index], grids[index], index, scale)
    figure.savefig(path, dpi=DOTS_PER_INCH)


def _draw_animation(frames: Sequence[DrawnFrame], grids: Sequence[AnyArray], scale: _Scale, path: Path) -> None:
    """An animated GIF of all frames."""
    figure = Figure(figsize=(4.6, 4.6))
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()

    def show(index: int) -> list[Any]:
        axes.clear()
        _draw_one(axes, frames[index], grids[index], index, scale)
        return []

    with matplotlib.rc_context({'animation.embed_limit': 100}):
        FuncAnimation(figure, show, frames=len(frames), interval=1000 // FRAMES_PER_SECOND).save(
            path, writer=PillowWriter(fps=FRAMES_PER_SECOND)
        )


def _spread(count: int, most: int) -> list[int]:
    """At most so many indices, evenly spread, first and last among them."""
    return sorted({round(place) for place in np.linspace(0, count - 1, min(count, most))})


def _range(grids: Sequence[AnyArray]) -> tuple[float, float]:
    """Smallest and largest finite value of all grids, never equal."""
    finite = [grid[np.isfinite(grid.astype(float))] for grid in grids]
    numbers = [values.astype(float) for values in finite if values.size]
    if not numbers:
        return 0.0, 1.0
    low, high = min(v.min() for v in numbers), max(v.max() for v in numbers)
    return float(low), float(high if high > low else low + 1.0)


def _draw_one(axes: Any, frame: DrawnFrame, grid: AnyArray, index: int, scale: _Scale) -> None:
    """One grid: light is high; red lines are the borders of blocks, thin ones those of PEs."""
    name, values, title = frame
    logical = np.asarray(values).dtype == bool
    axes.imshow(
        grid.astype(float),
        cmap='gray' if logical else 'viridis',
        vmin=0 if logical else scale.low,
        vmax=1 if logical else scale.high,
        interpolation='nearest',
    )
    rows, columns = grid.shape
    if max(rows, columns) <= FINE_GRID:
        for limit, line in ((columns, axes.axvline), (rows, axes.axhline)):
            for place in range(1, limit):
                line(place - 0.5, color='0.5', linewidth=0.25)
    for limit, line in ((columns, axes.axvline), (rows, axes.axhline)):
        for place in range(scale.es, limit, scale.es):
            line(place - 0.5, color='red', linewidth=0.9)
    number = f'  {index + 1}/{scale.frames}' if scale.frames > 1 else ''
    axes.set_title(f'{name} {title}{number}'.strip(), fontsize=10)
    axes.set_xticks([])
    axes.set_yticks([])


def html_plane(values: AnyArray, title: str, es: int, size: int = NOTEBOOK_PIXELS) -> str:
    """HTML of an array for a notebook: its title, and its values as grey levels, about ``size`` pixels high."""
    grid = grid_of(values, es).astype(float)
    grid = np.nan_to_num(grid, nan=0.0, posinf=0.0, neginf=0.0)
    scale = max(1, size // max(grid.shape))
    buffer = io.BytesIO()
    imsave(buffer, np.kron(grid, np.ones((scale, scale))), cmap='gray', format='png')
    picture = base64.b64encode(buffer.getvalue()).decode()
    return f'<p>{html.escape(title)}</p><img src="data:image/png;base64,{picture}">'
