"""Subgraph matching (thesis 5.8): the look-up tables are searched by quadrants, as a small array machine must.

The tree is that of tree.py. At each level a table's quadrants are taken by ascending number of matches, and four tests
decide whether one is entered at all: it must hold a match, and the model features to which the pair's data features
are already assigned must lie on its two sides.
"""

from __future__ import annotations

from ..params import MatchParams
from .tables import Tables
from .tree import TreeResult, search_with_bin, traverse_left


def subgraph_search(
    tables: Tables, params: MatchParams, limit: int = 256, seconds: float | None = None, eliminate: bool = True
) -> TreeResult:
    """As tree.tree_search, by quadrants of params.quadrant x params.quadrant model features."""
    return search_with_bin(tables, params.replace(search='subgraph'), limit, seconds, eliminate, traverse_left)
