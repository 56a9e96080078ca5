"""Embree as a peer of the renderer: the scene as triangles, the same rays, through embreex.

Needs embreex and, for the triangles, manifold3d; both only for this comparison. Embree gets a mesh, which is only as
round as its triangles are many, and gives the hits (distance, triangle) and no shading; we give the exact surface,
ids, normals and light.
"""

from __future__ import annotations

import importlib.util

import numpy as np
from measure import milliseconds

from csg_renderer import Scene, Solid
from csg_renderer.scene.mesh_export import mesh_of
from msgs_py import PinholeCamera

SEGMENTS = 64


def missing() -> str | None:
    """What is not installed, or None."""
    for name in ('embreex', 'manifold3d'):
        if importlib.util.find_spec(name) is None:
            return f'{name} is not installed'
    return None


def cast_time(scene: Scene, camera: PinholeCamera, budget_s: float) -> tuple[float, float, int]:
    """Median ms to cast a ray through every pixel, the share of rays that hit, and the number of triangles."""
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    whole: Solid = scene.solids[0]
    for solid in scene.solids[1:]:
        whole = whole | solid
    vertices, triangles, _ = mesh_of(whole, SEGMENTS)
    pose = scene.camera_T_scene.inverse()
    embree = rtcore_scene.EmbreeScene()
    TriangleMesh(embree, np.asarray(vertices, np.float32)[np.asarray(triangles)])
    rays = pose.rotate(camera.rays(camera.pixel_grid()).reshape(-1, 3)).astype(np.float32)
    origins = np.tile(pose.translation.astype(np.float32), (len(rays), 1))
    hit = embree.run(origins, rays)
    spent = milliseconds(lambda: embree.run(origins, rays, output=True), budget_s)
    return spent, float((hit >= 0).mean()), len(triangles)
