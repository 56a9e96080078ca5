"""Compiled ray tracing of scenes with pictures, metals, lights with a size and surroundings.

What secondary_rays.py is for Phong's model and points of light: a batch of rays in one scratch array, rays still to be
cast on a stack, the same rays and feelers. Here each ray has a colour as its weight, a cone, and random numbers.
"""

from __future__ import annotations

import math

import numpy as np

from ..programs.surface_data import NO_PICTURE
from ..settings import KEY_OFFSET, KEY_STEPS
from .lobes import albedo, from_matt, from_metal, glint, mixed, sample, to_ball, towards_five
from .rows import BLUE, DEPTH, GREEN, HIT, NX, PX, RED, STRIDE, VX, X, kernel
from .secondary_rays import (
    ANY_LEAF,
    BATCH_PARTS,
    BEST,
    DX,
    FACING,
    FROM,
    INF,
    LEVEL,
    LIGHT,
    MET,
    NORMAL,
    ONE,
    OX,
    PIXEL,
    REACH,
    TINT,
    ZERO,
    arriving_light,
    cast_rays,
    normals_batch,
    note_leaves,
)
from .shade import power
from .terrain import face_colour
from .textures import surroundings, texture_colour
from .tree import LEAF_STEP

# Weight of a ray in its pixel (red, green, blue); width of its cone, metres, and the cone's angle; its random numbers;
# how many directions of light it samples.
FILTER, WIDTH, SPREAD, KEY, COUNT = (np.uint64(STRIDE * (BATCH_PARTS + k)) for k in (0, 3, 4, 5, 6))
SURFACE_BATCH_PARTS = BATCH_PARTS + 7
# A pending ray: origin, direction, weight (3), level, pixel, width, spread, key, count.
SURFACE_RAY_PARTS = 15
# Streams of random numbers: the surroundings on matt surfaces, facets of metal, mirrored and transmitted rays, rays of
# facets by their number, and lights by theirs.
MATT_STREAM, METAL_STREAM, MIRROR_STREAM, GLASS_STREAM, FACET_STREAM, LIGHT_STREAM = 0, 1, 10, 11, 1 << 20, 1 << 10


@kernel
def add(row, pixel, s, j, share, red, green, blue):
    """Add light to a pixel of a row, as much as the filter of ray j lets through."""
    row[RED + pixel] += share * s[FILTER + j] * red
    row[GREEN + pixel] += share * s[FILTER + ONE + j] * green
    row[BLUE + pixel] += share * s[FILTER + ONE + ONE + j] * blue


@kernel
def push(space, pending, s, j, d, spread, filters, stream, count):
    """A ray from the place of ray j, in the direction d, onto the stack."""
    ray = space.stack[pending]
    ray[0], ray[1], ray[2] = s[OX + j], s[OX + ONE + j], s[OX + ONE + ONE + j]
    ray[3], ray[4], ray[5] = d
    ray[6], ray[7], ray[8] = filters
    ray[9], ray[10] = s[LEVEL + j] + 1.0, s[PIXEL + j]
    ray[11], ray[12] = s[WIDTH + j], spread
    ray[13], ray[14] = mixed(s[KEY + j], stream), count
    return pending + 1


@kernel
def tint_batch(s, n, csg, materials, space, terrains):
    """Colours of the places of a batch, with their pictures, into TINT."""
    maps = space.surfaces
    for j in range(ZERO, n):
        leaf = int(s[HIT + j] / LEAF_STEP)
        face = int(s[HIT + j] - leaf * LEAF_STEP) // 2
        x, y, z = s[OX + j], s[OX + ONE + j], s[OX + ONE + ONE + j]
        colours = materials.colours
        red, green, blue = colours[leaf, face, 0], colours[leaf, face, 1], colours[leaf, face, 2]
        if terrains is not None:
            red, green, blue = face_colour(terrains, materials, csg.inverse, leaf, face, x, y, z)
        r, g, b = texture_colour(
            maps,
            leaf,
            x,
            y,
            z,
            s[NORMAL + j],
            s[NORMAL + ONE + j],
            s[NORMAL + ONE + ONE + j],
            s[VX + j],
            s[VX + ONE + j],
            s[VX + ONE + ONE + j],
            s[WIDTH + j],
        )
        s[TINT + j], s[TINT + ONE + j], s[TINT + ONE + ONE + j] = red * r, green * g, blue * b


@kernel
def metal_colour(s, j, albedo_back, schlick):
    """What a metal of the colour TINT returns of white light: Fresnel by Schlick, and light between its facets."""
    red, green, blue = s[TINT + j], s[TINT + ONE + j], s[TINT + ONE + ONE + j]
    return (
        (red + (1.0 - red) * schlick) * (1.0 + red * albedo_back),
        (green + (1.0 - green) * schlick) * (1.0 + green * albedo_back),
        (blue + (1.0 - blue) * schlick) * (1.0 + blue * albedo_back),
    )


@kernel
def metal_rays(s, j, leaf, row, materials, space, pending):
    """The rays that the facets of a metal mirror: onto the stack, or to the surroundings at the last level."""
    maps = space.surfaces
    alpha, count = maps.roughness[leaf], int(s[COUNT + j])
    nx, ny, nz = s[NORMAL + j], s[NORMAL + ONE + j], s[NORMAL + ONE + ONE + j]
    vx, vy, vz = s[VX + j], s[VX + ONE + j], s[VX + ONE + ONE + j]
    returned = albedo(maps.albedo, -(nx * vx + ny * vy + nz * vz), alpha)
    back = (1.0 - returned) / returned
    for k in range(count):
        u, v = sample(s[KEY + j], METAL_STREAM, k)
        dx, dy, dz, share, along, density = from_metal(nx, ny, nz, vx, vy, vz, alpha, u, v)
        if share == 0.0:
            continue
        red, green, blue = metal_colour(s, j, back, towards_five(along))
        share /= count
        spread = max(s[SPREAD + j], math.sqrt(1.0 / (count * density)))
        if s[LEVEL + j] < space.rays.levels:
            filters = (
                share * red * s[FILTER + j],
                share * green * s[FILTER + ONE + j],
                share * blue * s[FILTER + ONE + ONE + j],
            )
            pending = push(space, pending, s, j, (dx, dy, dz), spread, filters, FACET_STREAM + k, 1.0)
        else:
            r, g, b = surroundings(maps, materials.background, dx, dy, dz, spread)
            add(row, np.uint64(s[PIXEL + j]), s, j, share, red * r, green * g, blue * b)
    return pending


@kernel
def surface_branch(s, n, row, materials, space, pending):
    """Push what a batch mirrors and lets through, and take what is let through off its FILTER; how many are pending."""
    for j in range(ZERO, n):
        leaf = int(s[HIT + j] / LEAF_STEP)
        mirror, clear = materials.coefficients[leaf, 4], materials.coefficients[leaf, 5]
        metal = space.surfaces.roughness[leaf] >= 0.0
        if s[LEVEL + j] >= space.rays.levels:
            mirror, clear = 0.0, 0.0
        vx, vy, vz = s[VX + j], s[VX + ONE + j], s[VX + ONE + ONE + j]
        red, green, blue = s[FILTER + j], s[FILTER + ONE + j], s[FILTER + ONE + ONE + j]
        if clear > 0.0:
            through = (clear * red, clear * green, clear * blue)
            d = (vx, vy, vz)
            pending = push(space, pending, s, j, d, s[SPREAD + j], through, GLASS_STREAM, s[COUNT + j])
            red, green, blue = (1.0 - clear) * red, (1.0 - clear) * green, (1.0 - clear) * blue
            s[FILTER + j], s[FILTER + ONE + j], s[FILTER + ONE + ONE + j] = red, green, blue
        if metal:
            pending = metal_rays(s, j, leaf, row, materials, space, pending)
        elif mirror > 0.0:
            nx, ny, nz = s[NORMAL + j], s[NORMAL + ONE + j], s[NORMAL + ONE + ONE + j]
            slope = 2.0 * (vx * nx + vy * ny + vz * nz)
            d = (vx - slope * nx, vy - slope * ny, vz - slope * nz)
            back = (mirror * red, mirror * green, mirror * blue)
            pending = push(space, pending, s, j, d, s[SPREAD + j], back, MIRROR_STREAM, s[COUNT + j])
    return pending


@kernel
def most_samples(s, n):
    """The largest COUNT of a batch."""
    most = 0.0
    for j in range(ZERO, n):
        most = max(most, s[COUNT + j])
    return int(most)


@kernel
def no_light(s, j):
    """No light comes to ray j, and its feeler reaches nowhere."""
    s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j] = 0.0, 0.0, 1.0
    s[LIGHT + j], s[FACING + j], s[REACH + j] = 0.0, 0.0, -INF


@kernel
def aim_at_light(s, n, light, k, materials, space):
    """The k-th feelers of a batch towards a light: DX, FACING, LIGHT (1 where it shines) and REACH."""
    maps = space.surfaces
    radius = maps.radius[light]
    lx, ly, lz = materials.lights[light, 0], materials.lights[light, 1], materials.lights[light, 2]
    for j in range(ZERO, n):
        if radius > 0.0 and k >= int(s[COUNT + j]):
            no_light(s, j)
            continue
        dx, dy, dz = lx - s[OX + j], ly - s[OX + ONE + j], lz - s[OX + ONE + ONE + j]
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        scale = 1.0 / distance
        dx, dy, dz = dx * scale, dy * scale, dz * scale
        if radius > 0.0:
            u, v = sample(s[KEY + j], LIGHT_STREAM + light, k)
            dx, dy, dz, distance = to_ball(dx, dy, dz, distance, radius, u, v)
        facing = s[NORMAL + j] * dx + s[NORMAL + ONE + j] * dy + s[NORMAL + ONE + ONE + j] * dz
        if facing > 0.0:
            s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j] = dx, dy, dz
            s[LIGHT + j], s[FACING + j], s[REACH + j] = 1.0, facing, distance - space.rays.departure
        else:
            no_light(s, j)


@kernel
def light_of(s, j, row, light, leaf, materials, space):
    """Add what of a light comes from the place of ray j."""
    maps = space.surfaces
    arriving = s[LIGHT + j]
    if maps.radius[light] > 0.0:
        arriving /= s[COUNT + j]
    colour = materials.light_colours[light]
    pixel = np.uint64(s[PIXEL + j])
    dx, dy, dz = s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j]
    nx, ny, nz = s[NORMAL + j], s[NORMAL + ONE + j], s[NORMAL + ONE + ONE + j]
    vx, vy, vz = s[VX + j], s[VX + ONE + j], s[VX + ONE + ONE + j]
    alpha = maps.roughness[leaf]
    if alpha >= 0.0:
        hx, hy, hz = dx - vx, dy - vy, dz - vz
        scale = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
        hx, hy, hz = hx * scale, hy * scale, hz * scale
        seen = -(nx * vx + ny * vy + nz * vz)
        returned = albedo(maps.albedo, seen, alpha)
        schlick = towards_five(hx * dx + hy * dy + hz * dz)
        red, green, blue = metal_colour(s, j, (1.0 - returned) / returned, schlick)
        share = arriving * glint(s[FACING + j], seen, nx * hx + ny * hy + nz * hz, alpha)
        add(row, pixel, s, j, share, red * colour[0], green * colour[1], blue * colour[2])
        return
    shade, highlight = arriving * materials.coefficients[leaf, 1] * s[FACING + j], 0.0
    specular = materials.coefficients[leaf, 2]
    if specular > 0.0:
        slope = 2.0 * (vx * nx + vy * ny + vz * nz)
        towards = (vx - slope * nx) * dx + (vy - slope * ny) * dy + (vz - slope * nz) * dz
        if towards > 0.0:
            highlight = arriving * specular * power(towards, materials.coefficients[leaf, 3])
    add(
        row,
        pixel,
        s,
        j,
        1.0,
        (shade * s[TINT + j] + highlight) * colour[0],
        (shade * s[TINT + ONE + j] + highlight) * colour[1],
        (shade * s[TINT + ONE + ONE + j] + highlight) * colour[2],
    )


@kernel
def light_from_around(s, n, row, csg, materials, work, space, terrains):
    """Add what matt surfaces return of the surroundings."""
    maps = space.surfaces
    for k in range(most_samples(s, n)):
        if work.counts[3] != 0:
            return
        for j in range(ZERO, n):
            leaf = int(s[HIT + j] / LEAF_STEP)
            if k >= int(s[COUNT + j]) or maps.roughness[leaf] >= 0.0:
                no_light(s, j)
                continue
            u, v = sample(s[KEY + j], MATT_STREAM, k)
            dx, dy, dz, cosine = from_matt(s[NORMAL + j], s[NORMAL + ONE + j], s[NORMAL + ONE + ONE + j], u, v)
            s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j] = dx, dy, dz
            s[LIGHT + j], s[FACING + j], s[REACH + j] = 1.0, cosine, INF
        if space.rays.shadows:
            arriving_light(s, n, csg, materials, work, space.rays, terrains)
        for j in range(ZERO, n):
            if s[LIGHT + j] == 0.0:
                continue
            leaf, count = int(s[HIT + j] / LEAF_STEP), s[COUNT + j]
            spread = math.sqrt(math.pi / (count * max(s[FACING + j], 1e-3)))
            dx, dy, dz = s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j]
            red, green, blue = surroundings(maps, materials.background, dx, dy, dz, spread)
            share = s[LIGHT + j] * materials.coefficients[leaf, 1] / count
            add(
                row,
                np.uint64(s[PIXEL + j]),
                s,
                j,
                share,
                red * s[TINT + j],
                green * s[TINT + ONE + j],
                blue * s[TINT + ONE + ONE + j],
            )


@kernel
def surface_light(s, n, row, csg, materials, work, space, terrains):
    """Add the light of a batch of places to RED, GREEN, BLUE of their pixels in ``row``."""
    maps = space.surfaces
    note_leaves(s, n)
    if maps.environment == NO_PICTURE:
        ambient = materials.ambient_light
        for j in range(ZERO, n):
            share = materials.coefficients[int(s[HIT + j] / LEAF_STEP), 0]
            add(
                row,
                np.uint64(s[PIXEL + j]),
                s,
                j,
                share,
                s[TINT + j] * ambient[0],
                s[TINT + ONE + j] * ambient[1],
                s[TINT + ONE + ONE + j] * ambient[2],
            )
    else:
        light_from_around(s, n, row, csg, materials, work, space, terrains)
    for light in range(materials.lights.shape[0]):
        for k in range(most_samples(s, n) if maps.radius[light] > 0.0 else 1):
            if work.counts[3] != 0:
                return
            aim_at_light(s, n, light, k, materials, space)
            if space.rays.shadows:
                arriving_light(s, n, csg, materials, work, space.rays, terrains)
            for j in range(ZERO, n):
                if s[LIGHT + j] > 0.0:
                    light_of(s, j, row, light, int(s[HIT + j] / LEAF_STEP), materials, space)


@kernel
def first_places(row, m, y, materials, space, plan):
    """The visible places of a row as the first batch; pixels that show none get the surroundings. How many."""
    s, maps = space.rays.batch, space.surfaces
    # Of the samples of a pixel each has a part.
    spread = plan.dx / max(plan.box, 1)
    n = ZERO
    for pixel in range(ZERO, np.uint64(m)):
        if row[HIT + pixel] < 0.0:
            if maps.environment != NO_PICTURE:
                x, r = row[X + pixel], plan.rotation
                dx = r[0, 0] * x + r[0, 1] * y + r[0, 2]
                dy = r[1, 0] * x + r[1, 1] * y + r[1, 2]
                dz = r[2, 0] * x + r[2, 1] * y + r[2, 2]
                scale = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
                red, green, blue = surroundings(maps, materials.background, dx * scale, dy * scale, dz * scale, spread)
                row[RED + pixel], row[GREEN + pixel], row[BLUE + pixel] = red, green, blue
            continue
        for axis in range(np.uint64(3)):
            step = axis * ONE
            s[OX + step + n] = row[PX + step + pixel]
            s[VX + step + n] = row[VX + step + pixel]
            s[NORMAL + step + n] = row[NX + step + pixel]
            s[FILTER + step + n] = 1.0
        s[HIT + n], s[LEVEL + n], s[PIXEL + n] = row[HIT + pixel], 1.0, pixel
        s[WIDTH + n], s[SPREAD + n], s[COUNT + n] = row[DEPTH + pixel] * spread, spread, space.samples
        across = np.rint(row[X + pixel] / plan.dx * KEY_STEPS) + KEY_OFFSET
        down = np.rint(y / plan.dy * KEY_STEPS) + KEY_OFFSET
        s[KEY + n] = mixed(mixed(across, 0), int(down))
        n += np.uint64(1)
    return n


@kernel
def take_rays(s, count, space, pending):
    """The topmost rays of the stack as a batch that is to be cast."""
    for i in range(count):
        slot, ray = np.uint64(i), space.stack[pending + i]
        for axis in range(np.uint64(3)):
            step = axis * ONE
            s[OX + step + slot], s[DX + step + slot], s[FILTER + step + slot] = ray[axis], ray[3 + axis], ray[6 + axis]
        s[LEVEL + slot], s[PIXEL + slot] = ray[9], ray[10]
        s[WIDTH + slot], s[SPREAD + slot], s[KEY + slot], s[COUNT + slot] = ray[11], ray[12], ray[13], ray[14]
        s[FROM + slot], s[HIT + slot] = ANY_LEAF, 0.0


@kernel
def met_places(s, count, row, materials, space):
    """Those of a batch that met something close ranks, the others see the surroundings. How many met something."""
    n = ZERO
    for j in range(ZERO, np.uint64(count)):
        dx, dy, dz = s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j]
        if s[MET + j] < 0.0:
            red, green, blue = surroundings(space.surfaces, materials.background, dx, dy, dz, s[SPREAD + j])
            add(row, np.uint64(s[PIXEL + j]), s, j, 1.0, red, green, blue)
            continue
        t = s[BEST + j]
        for axis in range(np.uint64(3)):
            step = axis * ONE
            s[OX + step + n] = s[OX + step + j] + t * s[DX + step + j]
            s[PX + step + n] = s[OX + step + n]
            s[VX + step + n] = s[DX + step + j]
            s[FILTER + step + n] = s[FILTER + step + j]
        s[HIT + n], s[LEVEL + n], s[PIXEL + n] = s[MET + j], s[LEVEL + j], s[PIXEL + j]
        s[WIDTH + n], s[SPREAD + n] = s[WIDTH + j] + t * s[SPREAD + j], s[SPREAD + j]
        s[KEY + n], s[COUNT + n] = s[KEY + j], s[COUNT + j]
        n += np.uint64(1)
    return n


@kernel
def surface_row(row, m, y, csg, materials, work, space, terrains, plan):
    """Colours, not clipped, of a row of camera rays (HIT, DEPTH, X; PX, VX, NX of hits), in its RED, GREEN, BLUE.

    The pixels that show something must come in black, the others as background.
    """
    s = space.rays.batch
    n = first_places(row, m, y, materials, space, plan)
    pending = 0
    while True:
        tint_batch(s, n, csg, materials, space, terrains)
        pending = surface_branch(s, n, row, materials, space, pending)
        surface_light(s, n, row, csg, materials, work, space, terrains)
        if pending == 0 or work.counts[3] != 0:
            return
        count = min(pending, STRIDE)
        pending -= count
        take_rays(s, count, space, pending)
        cast_rays(s, np.uint64(count), csg, work, space.rays, terrains)
        n = met_places(s, count, row, materials, space)
        normals_batch(s, n, csg, materials, terrains)
