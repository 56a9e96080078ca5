"""A program as the flat arrays that the compiled loops take: what no camera changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from msgs_py.numeric.typed import FloatArray, IntArray

from ..scene.terrain import Terrain
from .hierarchy import boxes_of
from .kernels.records import CsgPrograms, Materials, TerrainGrids
from .programs.products import products_of
from .programs.program import BLOCK, HALFSPACES, PLANE, Program
from .programs.tree_order import early_outs
from .settings import AMBIGUOUS, FAR, SPHERE_SLACK


@dataclass(frozen=True, eq=False)
class FlatProgram:
    """What of a program the kernels need and no camera changes. c children.

    Attributes
    ----------
    program : Program
    csg : CsgPrograms
    materials : Materials
    terrains : TerrainGrids or None
        None without any.
    child_products : (c, 2) int64
        First and last + 1 product of every child, equal when it must be evaluated by lists.
    listed, chosen : (k,), (p,) int64
        The children to evaluate by lists, and the products, for a camera outside all of them.
    most_subtracted : int
        The largest number of subtracted primitives of a product.
    """

    program: Program
    csg: CsgPrograms
    materials: Materials
    terrains: TerrainGrids | None
    child_products: IntArray
    listed: IntArray
    chosen: IntArray
    most_subtracted: int


def flatten(program: Program) -> FlatProgram:
    """Flatten a program for the kernels.

    Parameters
    ----------
    program : Program
        A scene (see :func:`csg_renderer.raycast.programs.program.program_of`).

    Returns
    -------
    FlatProgram
    """
    products = _products(program)
    spans = products.of_child
    return FlatProgram(
        program,
        _csg_programs(program, products),
        Materials(
            program.colours,
            program.material,
            _flat_normals(program),
            program.lights,
            program.light_colours,
            program.ambient_light,
            program.background,
        ),
        _terrain_grids(program),
        spans,
        np.flatnonzero(spans[:, 0] == spans[:, 1]),
        np.arange(len(products.positive), dtype=np.int64),
        products.most_subtracted,
    )


@dataclass(frozen=True, eq=False)
class _Products:
    """The products of all children: see CsgPrograms; of_child : as FlatProgram.child_products."""

    start: list[int]
    positive: list[int]
    factors: list[int]
    ambiguity: list[float]
    of_child: IntArray
    most_subtracted: int


def _products(program: Program) -> _Products:
    start, most_subtracted = [0], 0
    positive: list[int] = []
    factors: list[int] = []
    ambiguity: list[float] = []
    of_child = np.zeros((len(program.children), 2), dtype=np.int64)
    for child, code in enumerate(program.children):
        found = products_of(code) or []
        of_child[child] = len(positive), len(positive) + len(found)
        for inside, outside in found:
            factors += sorted(inside) + sorted(outside)
            start.append(len(factors))
            positive.append(len(inside))
            ambiguity.append(AMBIGUOUS if len(found) > 1 else 0.0)
            most_subtracted = max(most_subtracted, len(outside))
    return _Products(start, positive, factors, ambiguity, of_child, most_subtracted)


def _csg_programs(program: Program, products: _Products) -> CsgPrograms:
    codes: list[int] = []
    jumps: list[int] = []
    code_start = [0]
    simple = np.full(len(program.children), -1, dtype=np.int64)
    box, hierarchy = boxes_of(program)
    child_of = np.zeros(len(program.kind), dtype=np.int64)
    for child, code in enumerate(program.children):
        child_of[code[code >= 0]] = child
        jumps += [jump + len(codes) if jump else 0 for jump in early_outs(code)]
        codes += code.tolist()
        code_start.append(len(codes))
        if len(code) == 1:
            simple[child] = code[0]
    return CsgPrograms(
        whole_numbers(products.start),
        whole_numbers(products.positive),
        np.array(products.ambiguity),
        whole_numbers(products.factors),
        whole_numbers(code_start),
        whole_numbers(codes),
        whole_numbers(jumps),
        simple,
        child_of,
        box,
        hierarchy,
        program.kind,
        np.ascontiguousarray(program.inverse[:, :3]),
        _spheres(program),
        HALFSPACES[program.kind],
    )


def _terrain_grids(program: Program) -> TerrainGrids | None:
    if not program.terrains:
        return None
    grids = [cast(Terrain, program.leaves[leaf]) for leaf in program.terrains]
    sizes = [grid.heights.size for grid in grids]
    tints = [np.zeros((0, 4)) if grid.tints is None else grid.tints for grid in grids]
    return TerrainGrids(
        np.array(program.terrains),
        np.concatenate([grid.relief.ravel() for grid in grids]),
        np.concatenate([np.pad(grid.cells, ((0, 1), (0, 1))).ravel() for grid in grids]),
        np.cumsum([0, *sizes[:-1]]),
        np.array([grid.heights.shape[0] for grid in grids]),
        np.array([grid.heights.shape[1] for grid in grids]),
        np.array([grid.bilinear for grid in grids]),
        np.array([grid.range[0] for grid in grids]),
        np.array([grid.range[1] for grid in grids]),
        np.concatenate(tints),
        whole_numbers(np.cumsum([0, *(len(table) for table in tints)]).tolist()),
    )


def whole_numbers(numbers: list[int]) -> IntArray:
    """(n,) int64, also of an empty list, of which numpy would make floats."""
    return np.array(numbers, dtype=np.int64)


def _spheres(program: Program) -> FloatArray:
    """(n, 4): a sphere about each leaf in the scene frame, centre (metres) and squared radius."""
    spheres = np.zeros((len(program.kind), 4))
    for leaf, (first, last) in enumerate(zip(program.outline_start[:-1], program.outline_start[1:])):
        spheres[leaf, 3] = FAR
        if program.kind[leaf] != PLANE:
            points = program.outline[first:last]
            spheres[leaf, :3] = points.mean(axis=0)
            spheres[leaf, 3] = SPHERE_SLACK * ((points - spheres[leaf, :3]) ** 2).sum(axis=1).max()
    return spheres


def _flat_normals(program: Program) -> FloatArray:
    """(n, 6, 3): unit normals of flat faces, scene frame; which side is outward depends on the ray."""
    normals = np.zeros((len(program.kind), 6, 3))
    rows = program.inverse[:, :3, :3]
    for face in range(6):
        normals[:, face] = np.where((program.kind == BLOCK)[:, None], rows[:, face // 2], rows[:, 2])
    return normals / np.linalg.norm(normals, axis=2, keepdims=True) if len(normals) else normals
