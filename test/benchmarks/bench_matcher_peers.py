"""One model in clutter, by us and by what one might use instead, on the same data.

Peers: a plain serial tree in Python (Grimson and Lozano-Perez, look-ups by numpy), the compiled serial search, and the
largest clique of the compatibility graph by igraph or networkx. The graph's nodes are pairs of a data and a model edge;
pairs that agree under all five constraints are joined. Its making is part of a clique's time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from measure import Absent, Measurement, milliseconds

from model_matcher import MatchParams, index_model, match
from model_matcher.closed_form.synthetic.scenes import MODELS, make_scene
from model_matcher.interpretation_tree.tables import Tables, build_tables
from model_matcher.model.index import ModelIndex
from msgs_py import FeatureSet

CASES = (('l_shape', 0.0), ('l_shape', 0.5), ('chair', 0.3), ('chair', 0.5))
LIMIT_S = 5.0


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    budget = 0.3 if quick else 1.5
    solvers: dict[str, Any] = {}
    for name, solver in (('igraph', _igraph), ('networkx', _networkx)):
        try:
            __import__(name)
            solvers[name] = solver
        except ImportError:
            yield Absent(f'largest clique by {name}', f'{name} is not installed')
    for name, share in CASES[:2] if quick else CASES:
        index = index_model(MODELS[name](), name)
        data = make_scene(index.features, 1, clutter=share).data
        what = f'{name}, {len(data)} data edges, {100 * share:.0f} % clutter'
        yield Measurement(what, milliseconds(partial(match, index, data), budget))
        tree = MatchParams(search='tree')
        yield Measurement(what, milliseconds(partial(match, index, data, tree), budget), by='our tree with tables')
        serial = MatchParams(search='serial', time_limit_s=LIMIT_S)
        spent = milliseconds(partial(match, index, data, serial), budget, least=1)
        stopped = match(index, data, serial).stats['stopped_by']
        yield Measurement(what, spent, by='serial, compiled', note=_note(stopped))
        tables = build_tables(index, data, MatchParams())
        started = time.perf_counter()
        ended = _plain_tree(tables, LIMIT_S)
        yield Measurement(
            what,
            1e3 * (time.perf_counter() - started),
            by='serial tree, plain Python',
            note='tables given' + ('' if ended else f', stopped after {LIMIT_S:g} s'),
        )
        for peer, solver in solvers.items():
            yield Measurement(
                what,
                milliseconds(partial(_clique, solver, index, data), budget, least=1),
                by=f'largest clique, {peer}',
                note='making the graph included',
            )


def _note(stopped: str) -> str:
    return '' if stopped == 'exhausted' else f'stopped by its {stopped}'


def _plain_tree(tables: Tables, limit_s: float) -> bool:
    """Depth-first with a rising number of features in the bin; True when it found one in time."""
    code, n = tables.match, tables.unary.shape[0]
    end = time.perf_counter() + limit_s
    options = [np.flatnonzero(row) for row in tables.unary]

    def descend(level: int, chosen: list[int], left: int) -> bool:
        if level == n:
            return left == 0
        if time.perf_counter() > end:
            raise TimeoutError
        for j in options[level]:
            agrees = all(i < 0 or code[tables.number(a, level), i, j] for a, i in enumerate(chosen))
            if agrees and descend(level + 1, [*chosen, int(j)], left):
                return True
        return left > 0 and descend(level + 1, [*chosen, -1], left - 1)

    try:
        return any(descend(0, [], in_bin) for in_bin in range(n - 3))
    except TimeoutError:
        return False


def _clique(solver: Any, index: ModelIndex, data: FeatureSet) -> int:
    tables = build_tables(index, data, MatchParams())
    nodes = np.full(tables.unary.shape, -1)
    nodes[tables.unary] = np.arange(int(tables.unary.sum()))
    edges = []
    for pair, table in zip(tables.pairs, tables.match):
        i, j = np.nonzero(table)
        edges.append(np.column_stack([nodes[pair[0], i], nodes[pair[1], j]]))
    joined = np.concatenate(edges)
    return solver(int(tables.unary.sum()), joined[(joined >= 0).all(axis=1)])


def _igraph(count: int, edges: np.ndarray) -> int:
    import igraph

    return len(igraph.Graph(n=count, edges=edges.tolist()).largest_cliques()[0])


def _networkx(count: int, edges: np.ndarray) -> int:
    import networkx

    graph = networkx.Graph()
    graph.add_nodes_from(range(count))
    graph.add_edges_from(edges.tolist())
    return len(networkx.max_weight_clique(graph, weight=None)[0])
