"""Compiled shading: normals, Phong's light, shadow feelers, mirrors and glass. The formulas are those of shading.py."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .kernels import BASE, BLUE, DEPTH, GLINT, GREEN, NX, NY, NZ, PX, PY, PZ, RED, SHADE, VX, VY, VZ, X
from .kernels_tree import FACE_STEP, LEAF_STEP, NOTHING, child_list, local_span
from .program import CONE, CYLINDER, SPHERE
from .reference import APEX

INF = math.inf


class Look(NamedTuple):
    """Surfaces and lights (see program.Program). flat : (n, 6, 3) float64, unit normals of flat faces, scene frame."""

    colours: np.ndarray
    material: np.ndarray
    flat: np.ndarray
    lights: np.ndarray
    light_colours: np.ndarray
    ambient_light: np.ndarray
    background: np.ndarray


class Workspace(NamedTuple):
    """Scratch memory of one thread. row : the row of kernels.py; times, hits, starts : of child_list;
    rays : (m, 9) pending rays: origin, direction, weight, level; met : (c,) children a ray may meet; colours : (3, w)
    """

    row: np.ndarray
    times: np.ndarray
    hits: np.ndarray
    starts: np.ndarray
    rays: np.ndarray
    met: np.ndarray
    colours: np.ndarray
    counts: np.ndarray


@njit(cache=True, error_model='numpy', nogil=True)
def surface_normal(trees, look, hit, px, py, pz, dx, dy, dz):
    """Outward unit normal of the solid at a hit; (px, py, pz) the point and (dx, dy, dz) the ray, scene frame."""
    leaf = int(hit / LEAF_STEP)
    rest = int(hit - leaf * LEAF_STEP)
    face = rest // 2
    kind = trees.kind[leaf]
    if (kind == CYLINDER and face == 2) or (kind == CONE and face == 1) or kind == SPHERE:
        m = trees.inverse[leaf]
        gx = m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]
        gy = m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]
        gz = 0.0
        if kind != CYLINDER:
            gz = m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3]
            if kind == CONE:
                gz = -gz
        nx = m[0, 0] * gx + m[1, 0] * gy + m[2, 0] * gz
        ny = m[0, 1] * gx + m[1, 1] * gy + m[2, 1] * gz
        nz = m[0, 2] * gx + m[1, 2] * gy + m[2, 2] * gz
        if gx * gx + gy * gy + gz * gz < APEX:
            nx, ny, nz = -dx, -dy, -dz
        scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx * scale, ny * scale, nz * scale
    else:
        nx, ny, nz = look.flat[leaf, face, 0], look.flat[leaf, face, 1], look.flat[leaf, face, 2]
    # Where the ray enters, the outward normal faces it; where it leaves (an odd code), it does not.
    if (nx * dx + ny * dy + nz * dz < 0.0) == (rest % 2 == 1):
        nx, ny, nz = -nx, -ny, -nz
    return nx, ny, nz


@njit(cache=True, error_model='numpy', nogil=True)
def points_row(s, j0, j1, y, rotation):
    """Viewing rays and places of the hits of a row, scene frame, into VX..PZ."""
    ax, ay, az = rotation[0, 0], rotation[1, 0], rotation[2, 0]
    bx, by, bz = (rotation[0, 1] * y + rotation[0, 2], rotation[1, 1] * y + rotation[1, 2],
                  rotation[2, 1] * y + rotation[2, 2])
    cx, cy, cz = rotation[0, 3], rotation[1, 3], rotation[2, 3]
    for j in range(j0, j1):
        x, t = s[X + j], s[DEPTH + j]
        dx, dy, dz = ax * x + bx, ay * x + by, az * x + bz
        s[PX + j], s[PY + j], s[PZ + j] = cx + t * dx, cy + t * dy, cz + t * dz
        scale = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
        s[VX + j], s[VY + j], s[VZ + j] = dx * scale, dy * scale, dz * scale


@njit(cache=True, error_model='numpy', nogil=True)
def normals_run(s, j0, j1, leaf, face, kind, inverse, flat):
    """Unit normals, turned to the viewer, of a run of pixels that show one face, into NX, NY, NZ."""
    if (kind == CYLINDER and face == 2) or (kind == CONE and face == 1) or kind == SPHERE:
        m = inverse[leaf]
        m00, m01, m02, m03 = m[0, 0], m[0, 1], m[0, 2], m[0, 3]
        m10, m11, m12, m13 = m[1, 0], m[1, 1], m[1, 2], m[1, 3]
        m20, m21, m22, m23 = m[2, 0], m[2, 1], m[2, 2], m[2, 3]
        along = 0.0 if kind == CYLINDER else -1.0 if kind == CONE else 1.0
        for j in range(j0, j1):
            px, py, pz = s[PX + j], s[PY + j], s[PZ + j]
            vx, vy, vz = s[VX + j], s[VY + j], s[VZ + j]
            gx = m00 * px + m01 * py + m02 * pz + m03
            gy = m10 * px + m11 * py + m12 * pz + m13
            gz = along * (m20 * px + m21 * py + m22 * pz + m23)
            nx = m00 * gx + m10 * gy + m20 * gz
            ny = m01 * gx + m11 * gy + m21 * gz
            nz = m02 * gx + m12 * gy + m22 * gz
            apex = gx * gx + gy * gy + gz * gz < APEX
            nx, ny, nz = (-vx if apex else nx), (-vy if apex else ny), (-vz if apex else nz)
            scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
            nx, ny, nz = nx * scale, ny * scale, nz * scale
            scale = -1.0 if nx * vx + ny * vy + nz * vz > 0.0 else 1.0
            s[NX + j], s[NY + j], s[NZ + j] = scale * nx, scale * ny, scale * nz
    else:
        fx, fy, fz = flat[leaf, face, 0], flat[leaf, face, 1], flat[leaf, face, 2]
        for j in range(j0, j1):
            scale = -1.0 if fx * s[VX + j] + fy * s[VY + j] + fz * s[VZ + j] > 0.0 else 1.0
            s[NX + j], s[NY + j], s[NZ + j] = scale * fx, scale * fy, scale * fz


@njit(cache=True, error_model='numpy', nogil=True)
def light_run(s, j0, j1, leaf, face, colours, material, lights, light_colours, ambient_light):
    """Colours, not clipped, of a run of pixels that show one face, into RED, GREEN, BLUE: no shadows, no mirrors."""
    red, green, blue = colours[leaf, face, 0], colours[leaf, face, 1], colours[leaf, face, 2]
    ambient, diffuse = material[leaf, 0], material[leaf, 1]
    specular, shininess = material[leaf, 2], material[leaf, 3]
    ar, ag, ab = ambient * red * ambient_light[0], ambient * green * ambient_light[1], ambient * blue * ambient_light[2]
    for j in range(j0, j1):
        s[RED + j], s[GREEN + j], s[BLUE + j] = ar, ag, ab
    whole = int(shininess) if shininess < 4096.0 else 0
    for light in range(lights.shape[0]):
        lx, ly, lz = lights[light, 0], lights[light, 1], lights[light, 2]
        lr, lg, lb = light_colours[light, 0], light_colours[light, 1], light_colours[light, 2]
        for j in range(j0, j1):
            nx, ny, nz, vx, vy, vz = s[NX + j], s[NY + j], s[NZ + j], s[VX + j], s[VY + j], s[VZ + j]
            dx, dy, dz = lx - s[PX + j], ly - s[PY + j], lz - s[PZ + j]
            scale = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
            dx, dy, dz = dx * scale, dy * scale, dz * scale
            facing = nx * dx + ny * dy + nz * dz
            slope = 2.0 * (vx * nx + vy * ny + vz * nz)
            towards = (vx - slope * nx) * dx + (vy - slope * ny) * dy + (vz - slope * nz) * dz
            s[SHADE + j] = diffuse * facing if facing > 0.0 else 0.0
            lit = (facing > 0.0) & (towards > 0.0)
            s[BASE + j] = towards if lit else 0.0
            s[GLINT + j] = specular if lit else 0.0
        if specular > 0.0:
            if whole == shininess:
                exponent = whole
                while exponent > 0:
                    if exponent & 1:
                        for j in range(j0, j1):
                            s[GLINT + j] *= s[BASE + j]
                    exponent >>= 1
                    if exponent > 0:
                        for j in range(j0, j1):
                            s[BASE + j] *= s[BASE + j]
            else:
                for j in range(j0, j1):
                    s[GLINT + j] *= s[BASE + j] ** shininess
        for j in range(j0, j1):
            shade, glint = s[SHADE + j], s[GLINT + j]
            s[RED + j] += (shade * red + glint) * lr
            s[GREEN + j] += (shade * green + glint) * lg
            s[BLUE + j] += (shade * blue + glint) * lb


@njit(cache=True, error_model='numpy', nogil=True)
def power(base, exponent):
    """base ** exponent for base > 0; whole exponents by repeated squaring, which is ten times as fast."""
    whole = int(exponent) if exponent < 4096.0 else 0
    if whole != exponent:
        return base ** exponent
    result = 1.0
    while whole > 0:
        if whole & 1:
            result *= base
        base *= base
        whole >>= 1
    return result


@njit(cache=True, error_model='numpy', nogil=True)
def meet_children(trees, work, ox, oy, oz, dx, dy, dz, near, far):
    """Children whose bounding box a ray passes between near and far; how many, listed in work.met."""
    ix, iy, iz = 1.0 / dx, 1.0 / dy, 1.0 / dz
    box, met = trees.box, work.met
    found = 0
    for child in range(box.shape[1]):
        a, b = (box[0, child] - ox) * ix, (box[3, child] - ox) * ix
        low, high = min(a, b), max(a, b)
        a, b = (box[1, child] - oy) * iy, (box[4, child] - oy) * iy
        low, high = max(low, min(a, b)), min(high, max(a, b))
        a, b = (box[2, child] - oz) * iz, (box[5, child] - oz) * iz
        low, high = max(low, min(a, b)), min(high, max(a, b))
        # Written so that a NaN, of a ray in a side plane of a box, keeps the child.
        if not (low > high or low > far or high < near):
            met[found] = child
            found += 1
    return found


@njit(cache=True, error_model='numpy', nogil=True)
def nearest_entry(trees, work, ox, oy, oz, dx, dy, dz, departure, tolerance):
    """t and code of the first entry beyond ``departure`` along a ray of the scene frame; code NOTHING on a miss."""
    best, best_hit = INF, NOTHING
    for k in range(meet_children(trees, work, ox, oy, oz, dx, dy, dz, departure, INF)):
        child = work.met[k]
        leaf = trees.simple[child]
        entry, code = INF, NOTHING
        if leaf >= 0:
            near, far, face_in, face_out = local_span(trees.kind[leaf], trees.inverse[leaf], ox, oy, oz, dx, dy, dz)
            work.counts[0] += trees.halfspaces[leaf]
            work.counts[1] += 1
            if far - near > tolerance and near > departure:
                entry, code = near, leaf * LEAF_STEP + FACE_STEP * face_in
        else:
            count = child_list(trees, trees.inverse, child, ox, oy, oz, dx, dy, dz, tolerance, work.times, work.hits,
                               work.starts, work.counts)
            for i in range(0, count, 2):
                if work.times[i] > departure:
                    entry, code = work.times[i], work.hits[i]
                    break
        if code >= 0.0 and (entry < best - tolerance or (entry <= best + tolerance and code < best_hit)):
            best, best_hit = entry, code
    return best, best_hit


@njit(cache=True, error_model='numpy', nogil=True)
def transmission(trees, look, work, ox, oy, oz, dx, dy, dz, distance, departure, tolerance):
    """How much light comes along a ray of unit direction and this length: the product of transparencies in the way."""
    light = 1.0
    for k in range(meet_children(trees, work, ox, oy, oz, dx, dy, dz, departure, distance - departure)):
        child = work.met[k]
        leaf = trees.simple[child]
        if leaf >= 0:
            near, far, face_in, face_out = local_span(trees.kind[leaf], trees.inverse[leaf], ox, oy, oz, dx, dy, dz)
            work.counts[0] += trees.halfspaces[leaf]
            work.counts[1] += 1
            if far - near > tolerance and near < distance - departure and far > departure:
                light *= look.material[leaf, 5]
        else:
            count = child_list(trees, trees.inverse, child, ox, oy, oz, dx, dy, dz, tolerance, work.times, work.hits,
                               work.starts, work.counts)
            for i in range(0, count, 2):
                if work.times[i] < distance - departure and work.times[i + 1] > departure:
                    light *= look.material[int(work.hits[i] / LEAF_STEP), 5]
        if light == 0.0:
            break
    return light


@njit(cache=True, error_model='numpy', nogil=True)
def illuminate(trees, look, work, hit, px, py, pz, nx, ny, nz, vx, vy, vz, shadows, departure, tolerance):
    """Linear red, green, blue, not clipped; v : unit viewing ray, n : unit normal on the viewer's side."""
    leaf = int(hit / LEAF_STEP)
    face = int(hit - leaf * LEAF_STEP) // 2
    cr, cg, cb = look.colours[leaf, face, 0], look.colours[leaf, face, 1], look.colours[leaf, face, 2]
    ambient, diffuse = look.material[leaf, 0], look.material[leaf, 1]
    specular, shininess = look.material[leaf, 2], look.material[leaf, 3]
    red = ambient * cr * look.ambient_light[0]
    green = ambient * cg * look.ambient_light[1]
    blue = ambient * cb * look.ambient_light[2]
    slope = 2.0 * (vx * nx + vy * ny + vz * nz)
    mx, my, mz = vx - slope * nx, vy - slope * ny, vz - slope * nz
    for light in range(look.lights.shape[0]):
        lx, ly, lz = look.lights[light, 0] - px, look.lights[light, 1] - py, look.lights[light, 2] - pz
        facing = nx * lx + ny * ly + nz * lz
        if facing <= 0.0:
            continue
        distance = math.sqrt(lx * lx + ly * ly + lz * lz)
        scale = 1.0 / distance
        lx, ly, lz = lx * scale, ly * scale, lz * scale
        arriving = 1.0
        if shadows:
            arriving = transmission(trees, look, work, px, py, pz, lx, ly, lz, distance, departure, tolerance)
            if arriving == 0.0:
                continue
        shade = arriving * diffuse * facing * scale
        glint = 0.0
        if specular > 0.0:
            towards = mx * lx + my * ly + mz * lz
            if towards > 0.0:
                glint = arriving * specular * power(towards, shininess)
        red += (shade * cr + glint) * look.light_colours[light, 0]
        green += (shade * cg + glint) * look.light_colours[light, 1]
        blue += (shade * cb + glint) * look.light_colours[light, 2]
    return red, green, blue


@njit(cache=True, error_model='numpy', nogil=True)
def trace(trees, look, work, hit, px, py, pz, nx, ny, nz, vx, vy, vz, levels, shadows, departure, tolerance):
    """Colour of a visible point with what is mirrored in it and seen through it (thesis 4.2, 4.5).

    The stack of pending rays holds each ray's weight in the pixel, so nothing has to be unwound.
    """
    rays = work.rays
    pending = 0
    red, green, blue = 0.0, 0.0, 0.0
    weight, level = 1.0, 1
    while True:
        if hit >= 0.0:
            leaf = int(hit / LEAF_STEP)
            mirror, clear = look.material[leaf, 4], look.material[leaf, 5]
            if level >= levels:
                mirror, clear = 0.0, 0.0
            share = weight * (1.0 - clear)
            if share > 0.0:
                r, g, b = illuminate(trees, look, work, hit, px, py, pz, nx, ny, nz, vx, vy, vz, shadows, departure,
                                     tolerance)
                red, green, blue = red + share * r, green + share * g, blue + share * b
                if mirror > 0.0:
                    slope = 2.0 * (vx * nx + vy * ny + vz * nz)
                    ray = rays[pending]
                    ray[0], ray[1], ray[2] = px, py, pz
                    ray[3], ray[4], ray[5] = vx - slope * nx, vy - slope * ny, vz - slope * nz
                    ray[6], ray[7] = share * mirror, level + 1
                    pending += 1
            if clear > 0.0:
                ray = rays[pending]
                ray[0], ray[1], ray[2], ray[3], ray[4], ray[5] = px, py, pz, vx, vy, vz
                ray[6], ray[7] = weight * clear, level + 1
                pending += 1
        else:
            red += weight * look.background[0]
            green += weight * look.background[1]
            blue += weight * look.background[2]
        if pending == 0:
            return red, green, blue
        pending -= 1
        ray = rays[pending]
        ox, oy, oz, vx, vy, vz = ray[0], ray[1], ray[2], ray[3], ray[4], ray[5]
        weight, level = ray[6], int(ray[7])
        t, hit = nearest_entry(trees, work, ox, oy, oz, vx, vy, vz, departure, tolerance)
        if hit >= 0.0:
            px, py, pz = ox + t * vx, oy + t * vy, oz + t * vz
            nx, ny, nz = surface_normal(trees, look, hit, px, py, pz, vx, vy, vz)
