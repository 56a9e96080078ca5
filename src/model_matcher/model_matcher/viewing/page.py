"""Moments as one page that needs nothing else, neither files nor a network."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from msgs_py import FeatureSet

from .moments import Moment, model_lines, moment_record

NO_PLOTLY = 'the page draws with plotly, which is not installed: pip install plotly'
PARTIAL_PLOTLY = (
    'the plotly that is installed has no plotly.min.js (that of Debian and Ubuntu leaves it out): pip install plotly'
)


class NoPlotly(ValueError):
    """What draws the page is not installed; the text names the remedy."""


def page_of(title: str, models: Mapping[str, FeatureSet], moments: Sequence[Moment] | None) -> str:
    """Make the page.

    Parameters
    ----------
    title : str
    models : mapping of str to FeatureSet
        By name, model frame, metres.
    moments : sequence of Moment, optional
        In their order; without it the page asks its server for what is live.

    Returns
    -------
    str
        HTML without a reference to any other file or address, but for the server's ``events`` of a live one.

    Raises
    ------
    NoPlotly
        plotly, or the part of it that browsers run, is missing.
    """
    data = {
        'title': title,
        'models': model_lines(models),
        'moments': None if moments is None else [moment_record(one) for one in moments],
    }
    return Template(_part('page.html')).substitute(
        title=html.escape(title),
        style=_part('page.css').strip(),
        library=plotly_script(),
        script=_part('page.js').strip(),
        # Nothing inside may end the script element that it stands in.
        data=json_text(data).replace('<', '\\u003c'),
    )


def write_page(path: str | Path, title: str, models: Mapping[str, FeatureSet], moments: Sequence[Moment]) -> None:
    """Write the page of :func:`page_of` to a file.

    Raises
    ------
    ValueError
        When the name does not end in .html, or plotly is missing.
    OSError
        When it cannot be written.
    """
    path = Path(path)
    check_page_name(path)
    path.write_text(page_of(title, models, moments), encoding='utf-8')


def check_page_name(path: Path) -> None:
    """Raise ValueError unless a file name ends in .html."""
    if path.suffix.lower() not in ('.html', '.htm'):
        raise ValueError(f'{path}: expected a file name ending in .html')


def json_text(record: Any) -> str:
    """JSON in one line."""
    return json.dumps(record, separators=(',', ':'), allow_nan=False)


def plotly_script() -> str:
    """plotly.js as its Python package ships it. Raises NoPlotly."""
    try:
        file = resources.files('plotly').joinpath('package_data/plotly.min.js')
    except ImportError:
        raise NoPlotly(NO_PLOTLY) from None
    if not file.is_file():
        raise NoPlotly(PARTIAL_PLOTLY)
    return file.read_text(encoding='utf-8').replace('</script', '<\\/script')


def _part(name: str) -> str:
    """A file of this room."""
    return resources.files(__package__).joinpath(name).read_text(encoding='utf-8')
