"""Compiled shading of rows of pixels: normals and Phong's light, by the formulas of shading.py."""

from __future__ import annotations

import math

from ..programs.program import CONE, CYLINDER, SPHERE
from ..settings import APEX, MOST_SQUARED_EXPONENT
from .rows import (
    BLUE,
    DEPTH,
    DIFFUSE,
    GREEN,
    NX,
    NY,
    NZ,
    PX,
    PY,
    PZ,
    RED,
    SPECULAR,
    SPECULAR_BASE,
    VX,
    VY,
    VZ,
    X,
    kernel,
    ray_y,
)


@kernel
def points_row(s, j0, j1, y, rotation):
    """Viewing rays and places of the hits of a row, scene frame, into VX..PZ."""
    ax, ay, az = rotation[0, 0], rotation[1, 0], rotation[2, 0]
    bx, by, bz = rotation[0, 1], rotation[1, 1], rotation[2, 1]
    zx, zy, zz = rotation[0, 2], rotation[1, 2], rotation[2, 2]
    cx, cy, cz = rotation[0, 3], rotation[1, 3], rotation[2, 3]
    for j in range(j0, j1):
        x, v, t = s[X + j], ray_y(s, j, y), s[DEPTH + j]
        dx, dy, dz = ax * x + (bx * v + zx), ay * x + (by * v + zy), az * x + (bz * v + zz)
        s[PX + j], s[PY + j], s[PZ + j] = cx + t * dx, cy + t * dy, cz + t * dz
        scale = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
        s[VX + j], s[VY + j], s[VZ + j] = dx * scale, dy * scale, dz * scale


@kernel
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


@kernel
def light_run(s, j0, j1, leaf, colour, materials):
    """Colours, not clipped, of pixels of one leaf and colour, into RED, GREEN, BLUE: no shadows, no mirrors."""
    coefficients = materials.coefficients
    lights, light_colours, ambient_light = materials.lights, materials.light_colours, materials.ambient_light
    red, green, blue = colour
    ambient, diffuse = coefficients[leaf, 0], coefficients[leaf, 1]
    specular, shininess = coefficients[leaf, 2], coefficients[leaf, 3]
    ar, ag, ab = ambient * red * ambient_light[0], ambient * green * ambient_light[1], ambient * blue * ambient_light[2]
    for j in range(j0, j1):
        s[RED + j], s[GREEN + j], s[BLUE + j] = ar, ag, ab
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
            s[DIFFUSE + j] = diffuse * facing if facing > 0.0 else 0.0
            lit = (facing > 0.0) & (towards > 0.0)
            s[SPECULAR_BASE + j] = towards if lit else 0.0
            s[SPECULAR + j] = specular if lit else 0.0
        if specular > 0.0:
            raise_highlights(s, j0, j1, shininess)
        for j in range(j0, j1):
            shade, highlight = s[DIFFUSE + j], s[SPECULAR + j]
            s[RED + j] += (shade * red + highlight) * lr
            s[GREEN + j] += (shade * green + highlight) * lg
            s[BLUE + j] += (shade * blue + highlight) * lb


@kernel
def raise_highlights(s, j0, j1, shininess):
    """SPECULAR *= SPECULAR_BASE ** shininess; whole exponents by repeated squaring, which is ten times as fast."""
    whole = int(shininess) if shininess < MOST_SQUARED_EXPONENT else 0
    if whole == shininess:
        exponent = whole
        while exponent > 0:
            if exponent & 1:
                for j in range(j0, j1):
                    s[SPECULAR + j] *= s[SPECULAR_BASE + j]
            exponent >>= 1
            if exponent > 0:
                for j in range(j0, j1):
                    s[SPECULAR_BASE + j] *= s[SPECULAR_BASE + j]
    else:
        for j in range(j0, j1):
            s[SPECULAR + j] *= s[SPECULAR_BASE + j] ** shininess


@kernel
def power(base, exponent):
    """Power base ** exponent for base > 0; whole exponents by repeated squaring, which is ten times as fast."""
    whole = int(exponent) if exponent < MOST_SQUARED_EXPONENT else 0
    if whole != exponent:
        return base**exponent
    result = 1.0
    while whole > 0:
        if whole & 1:
            result *= base
        base *= base
        whole >>= 1
    return result
