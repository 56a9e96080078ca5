"""Pictures of arrays as the grid of PEs: PNG, animated GIF, and small pictures for notebooks."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

SUFFIXES = ('.png', '.gif')
# Grid lines between single PEs are drawn up to this many elements a side.
FINE_GRID = 80
FRAMES_PER_SECOND = 5


def grid_of(values: np.ndarray, es: int) -> np.ndarray:
    """(rows, columns): a matrix as it is; a vector folded down the columns of ES x ES blocks, blocks side by side."""
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


def draw(frames: Sequence[tuple[str, np.ndarray, str]], path: str | Path, es: int = 32) -> None:
    """Write (name, values, title) frames: a PNG of the last (with a strip of earlier ones), or a GIF of all.

    Raises ValueError for another suffix or no frames.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f'show: expected a file name ending in {" or ".join(SUFFIXES)}, got {path.name!r}')
    if not frames:
        raise ValueError('show: there is nothing to draw')
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    grids = [grid_of(values, es) for _, values, _ in frames]
    low, high = _range(grids)
    if path.suffix.lower() == '.png':
        chosen = _spread(len(frames), 6)
        figure = Figure(figsize=(1.0 + 3.6 * len(chosen), 4.2), layout='constrained')
        FigureCanvasAgg(figure)
        for place, index in enumerate(chosen):
            axes = figure.add_subplot(1, len(chosen), place + 1)
            _draw_one(axes, frames[index], grids[index], es, low, high, index, len(frames))
        figure.savefig(path, dpi=110)
        return
    from matplotlib.animation import FuncAnimation, PillowWriter

    figure = Figure(figsize=(4.6, 4.6))
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()

    def show(index: int) -> list:
        axes.clear()
        _draw_one(axes, frames[index], grids[index], es, low, high, index, len(frames))
        return []

    with matplotlib.rc_context({'animation.embed_limit': 100}):
        FuncAnimation(figure, show, frames=len(frames), interval=1000 // FRAMES_PER_SECOND).save(
            path, writer=PillowWriter(fps=FRAMES_PER_SECOND)
        )


def _spread(count: int, most: int) -> list[int]:
    """At most so many indices, first and last among them."""
    return sorted({round(place) for place in np.linspace(0, count - 1, min(count, most))})


def _range(grids: Sequence[np.ndarray]) -> tuple[float, float]:
    finite = [grid[np.isfinite(grid.astype(float))] for grid in grids]
    numbers = [values.astype(float) for values in finite if values.size]
    if not numbers:
        return 0.0, 1.0
    low, high = min(v.min() for v in numbers), max(v.max() for v in numbers)
    return float(low), float(high if high > low else low + 1.0)


def _draw_one(
    axes, frame: tuple[str, np.ndarray, str], grid: np.ndarray, es: int, low: float, high: float, index: int, count: int
) -> None:
    """One grid: light is high; red lines are the borders of blocks, thin ones those of PEs."""
    name, values, title = frame
    logical = np.asarray(values).dtype == bool
    axes.imshow(
        grid.astype(float),
        cmap='gray' if logical else 'viridis',
        vmin=0 if logical else low,
        vmax=1 if logical else high,
        interpolation='nearest',
    )
    rows, columns = grid.shape
    if max(rows, columns) <= FINE_GRID:
        for limit, line in ((columns, axes.axvline), (rows, axes.axhline)):
            for place in range(1, limit):
                line(place - 0.5, color='0.5', linewidth=0.25)
    for limit, line in ((columns, axes.axvline), (rows, axes.axhline)):
        for place in range(es, limit, es):
            line(place - 0.5, color='red', linewidth=0.9)
    number = f'  {index + 1}/{count}' if count > 1 else ''
    axes.set_title(f'{name} {title}{number}'.strip(), fontsize=10)
    axes.set_xticks([])
    axes.set_yticks([])


def html_plane(values: np.ndarray, title: str, es: int, size: int = 192) -> str:
    """HTML of an array for a notebook: its title, and its values as grey levels, about ``size`` pixels high."""
    # matplotlib takes 0.4 s to import, and only pictures need it.
    from matplotlib.image import imsave

    grid = grid_of(values, es).astype(float)
    grid = np.nan_to_num(grid, nan=0.0, posinf=0.0, neginf=0.0)
    scale = max(1, size // max(grid.shape))
    buffer = io.BytesIO()
    imsave(buffer, np.kron(grid, np.ones((scale, scale))), cmap='gray', format='png')
    picture = base64.b64encode(buffer.getvalue()).decode()
    return f'<p>{html.escape(title)}</p><img src="data:image/png;base64,{picture}">'
