"""What the compiled loops need of one view: leaves in the camera frame, their pixels, and the order front to back."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from .flatten import FlatProgram, whole_numbers
from .frame import RenderOptions
from .kernels.image import product_spans
from .kernels.records import CameraData, Differences, Plan
from .programs.program import CONE, CYLINDER, DIFFERENCE, INTERSECT, SPHERE, Program, View
from .raw_view import box_samples
from .settings import LEAST_CLIP_DEPTH, LONGEST_ROW, NARROWEST, PARALLEL, ROUND_ERROR
from .tiling import edge_lines, leaf_spans


class ViewData(NamedTuple):
    """What a pose of the camera makes of the leaves, small arrays. n leaves, p outline points.

    Attributes
    ----------
    origin, limit, sphere
        As in CameraData.
    points : (p, 3)
        Outlines, metres, camera frame.
    listed
        Children to evaluate by lists.
    chosen
        Products to evaluate.
    """

    origin: FloatArray
    limit: FloatArray
    points: FloatArray
    sphere: FloatArray
    listed: IntArray
    chosen: IntArray


def view_data(flat: FlatProgram, view: View, camera_T_scene: Pose) -> ViewData:
    """What depends on the pose of the camera and takes no time worth sharing between threads."""
    program, csg, local = flat.program, flat.csg, view.local
    home = local[:, :, 3]
    nearest = np.round(home)
    origin = np.where(np.abs(home - nearest) < PARALLEL * (1.0 + np.abs(home)), nearest, home)
    limit = PARALLEL * np.abs(local[:, :, :3]).sum(axis=2)
    listed, chosen = flat.listed, flat.chosen
    inside = _children_containing(program, origin)
    if any(inside):
        # From inside a solid its far wall is seen. Lists hold the exits of rays too, products only the entries.
        spans = flat.child_products.tolist()
        listed = whole_numbers([child for child, (first, last) in enumerate(spans) if first == last or inside[child]])
        chosen = whole_numbers(
            [q for child, (first, last) in enumerate(spans) if not inside[child] for q in range(first, last)]
        )
    sphere = np.empty_like(csg.sphere)
    sphere[:, :3] = camera_T_scene.apply(csg.sphere[:, :3])
    sphere[:, 3] = csg.sphere[:, 3] * camera_T_scene.scale**2
    return ViewData(np.ascontiguousarray(origin), limit, camera_T_scene.apply(program.outline), sphere, listed, chosen)


def plan_of(
    flat: FlatProgram, view: View, data: ViewData, camera: PinholeCamera, options: RenderOptions
) -> tuple[CameraData, Plan]:
    """Which pixels of which rows show which products, and the order of the products front to back."""
    program, csg = flat.program, flat.csg
    h, w = camera.height, camera.width
    whole = not options.tiling
    size = options.tile_size if options.tiling else LONGEST_ROW
    products, bands = len(csg.positive), -(-h // size)
    chosen = data.chosen
    near = np.zeros(products)
    leaf_depth = np.empty(len(program.kind))
    if whole:
        leaf_span, span, band = (np.zeros((1, 1, 2), dtype=np.int32) for _ in range(3))
    else:
        leaf_span = np.empty((len(program.kind), h, 2), dtype=np.int32)
        leaf_spans(
            data.points,
            program.outline_start,
            view.departure or LEAST_CLIP_DEPTH,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy,
            w,
            leaf_span,
            leaf_depth,
        )
        span = np.empty((products, h, 2), dtype=np.int32)
        band = np.empty((products, bands, 2), dtype=np.int32)
        product_spans(chosen, csg, leaf_span, leaf_depth, size, span, band, near)
        chosen = chosen[np.argsort(near[chosen], kind='stable')]
    camera_data = CameraData(
        view.local, data.origin, data.limit, data.sphere, leaf_span, near, data.listed, chosen, leaf_depth
    )
    plan = Plan(
        (np.arange(w, dtype=np.float64) - camera.cx) / camera.fx,
        (np.arange(h, dtype=np.float64) - camera.cy) / camera.fy,
        1.0 / camera.fx,
        1.0 / camera.fy,
        np.ascontiguousarray(view.scene_T_camera[:3]),
        view.tolerance,
        span,
        band,
        size,
        whole,
        0 if options.sparse else options.box,
        options.box,
        box_samples(options.box),
    )
    return camera_data, plan


def differences(
    flat: FlatProgram, view: View, data: ViewData, camera: PinholeCamera, camera_T_scene: Pose
) -> Differences:
    """What tells where samples of a pixel may differ."""
    program, materials = flat.program, flat.materials
    n = len(program.kind)
    unit_T_camera = np.zeros((n, 4, 4))
    unit_T_camera[:, :3], unit_T_camera[:, 3, 3] = view.local, 1.0
    bounds, start = np.empty((n, 4)), np.empty(n + 1, dtype=np.int64)
    lines = edge_lines(
        program.kind,
        np.ascontiguousarray(np.linalg.inv(unit_T_camera)[:, :3]),
        data.origin,
        view.departure or LEAST_CLIP_DEPTH,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        bounds,
        start,
    )
    round_ = (program.kind == CYLINDER) | (program.kind == CONE) | (program.kind == SPHERE)
    children = flat.csg.child_of
    bent = np.zeros(len(program.children), dtype=bool)
    np.logical_or.at(bent, children, round_)
    _, diffuse, specular, shininess = materials.coefficients[:, :4].T
    lights = materials.light_colours
    # Of what is round, but not along a cylinder.
    stretch = view.local[:, :, :3] * np.where((program.kind == CYLINDER)[:, None, None], [[1.0], [1.0], [0.0]], 1.0)
    # Contiguous for any number of leaves: of one leaf it is in any case, and that would be compiled once more.
    bend = np.ascontiguousarray(np.linalg.eigvalsh(stretch.transpose(0, 2, 1) @ stretch)[:, 2])
    products = flat.child_products[children] if n else np.zeros((0, 2), dtype=np.int64)
    products[np.isin(children, data.listed)] = 0
    # The mirrored ray turns twice as fast as the normal; a highlight's sigma is 1 / sqrt(shininess).
    turn = 0.5 / (NARROWEST * np.sqrt(np.maximum(shininess, 1.0)))
    narrow = np.where(round_ & (specular > 0.0), turn**2, np.inf)
    return Differences(
        lines,
        start,
        bounds,
        bend,
        diffuse * lights.sum(axis=0).max(initial=0.0),
        # cos^s falls by no more than sqrt(s / e) a radian.
        specular * np.sqrt(np.maximum(shininess, 1.0) / np.e) * lights.max(initial=0.0),
        narrow,
        products,
        np.where(round_, ROUND_ERROR, 0.0),
        camera_T_scene.apply(materials.lights),
        bent[children] if n else np.zeros(0, dtype=bool),
    )


def _children_containing(program: Program, origin: FloatArray) -> list[bool]:
    """Whether the camera, at these (n, 3) local origins, is inside each child or on its surface."""
    inside = _leaves_containing(program, origin)
    if not inside.any():
        return [False] * len(program.children)
    answers = []
    for code in program.children:
        stack: list[bool] = []
        for op in code:
            if op >= 0:
                stack.append(bool(inside[op]))
            else:
                # A subtracted primitive whose surface the camera touches may not cover it. So none is counted: more
                # children than necessary are evaluated by lists, which is slower and never wrong.
                right, left = stack.pop(), stack.pop()
                stack.append(left and right if op == INTERSECT else left if op == DIFFERENCE else left or right)
        answers.append(stack[0])
    return answers


def _leaves_containing(program: Program, origin: FloatArray) -> BoolArray:
    """(n,): is the camera, at these (n, 3) local origins, inside each leaf or on its surface? Never in a terrain."""
    x, y, z = origin.T if len(origin) else np.zeros((3, 0))
    slab = (z >= 0.0) & (z <= 1.0)
    square = x * x + y * y
    per_kind = np.stack(
        [
            (x >= 0) & (x <= 1) & (y >= 0) & (y <= 1) & slab,
            (square <= 1.0) & slab,
            (square <= z * z) & slab,
            square + z * z <= 1.0,
            z <= 0.0,
            np.zeros(z.shape, dtype=bool),
        ]
    )
    inside: BoolArray = per_kind[program.kind, np.arange(len(program.kind))]
    return inside
