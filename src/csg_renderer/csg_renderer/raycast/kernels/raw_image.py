"""Compiled image loops of a camera whose lens distorts: a ray of its own for every sample of every raw pixel.

The rows of a raw picture are curved, so that its rays share nothing with each other, and the loops over rows of rays
(rows.py) are used with rays one by one. Which primitives a ray may meet is looked up in the spans of an ideal camera
that sees all that the raw one sees.
"""

from __future__ import annotations

import math

import numpy as np

from msgs_py.numeric.compiled import njit

from .image import byte, colour_row, hit_row, lit_row, on_boundary, write_truth
from .records import PixelRun
from .rows import BLUE, GREEN, RED, X, kernel

ZERO = np.uint64(0)
ONE = np.int64(1)
# No pixel of the ideal camera stands for a ray one to one (see hit_row).
SCATTERED = np.int64(-1)
# Raw pixels of the side of a cell of a sample; they are fractions of one, except next to a fold of the lens.
LARGEST_CELL = 2.0


@kernel
def raw_sample(rays, row, column, du, dv):
    """The ray (x, y, 1) at an offset, pixels, from the centre of a raw pixel.

    The second order of a lens over a pixel is all that double precision of a picture shows: what is left out is below a
    millionth of a pixel. Beside what the lens does not show it is the ray of the centre.
    """
    i, j = row + 1, column + 1
    x, y = rays[i, j, 0], rays[i, j, 1]
    at = (x, y)
    for k in range(2):
        right, left, down, up = rays[i, j + 1, k], rays[i, j - 1, k], rays[i + 1, j, k], rays[i - 1, j, k]
        cross = rays[i + 1, j + 1, k] - rays[i + 1, j - 1, k] - rays[i - 1, j + 1, k] + rays[i - 1, j - 1, k]
        c = rays[i, j, k]
        value = (
            c
            + 0.5 * (du * (right - left) + dv * (down - up))
            + 0.5 * (du * du * (right - 2.0 * c + left) + dv * dv * (down - 2.0 * c + up))
            + 0.25 * du * dv * cross
        )
        at = (value, at[1]) if k == 0 else (at[0], value)
    if math.isnan(at[0]) or math.isnan(at[1]):
        return x, y
    return at


@kernel
def shoot(x, y, csg, camera, materials, plan, work, tracing, terrains, raw, coloured):
    """The nearest hit of one ray (x, y, 1), and its colour if ``coloured``, at the start of work.row.

    tracing : secondary and surfaces of colour_row, which are settled when compiling
    """
    row = min(max(int(math.floor(raw.fy * y + raw.cy + 0.5)), 0), raw.height - 1)
    column = min(max(int(math.floor(raw.fx * x + raw.cx + 0.5)), 0), raw.width - 1)
    work.row[X] = x
    chosen = camera.chosen
    run = PixelRun(row, column, column, row)
    hit_row(work, ONE, run, y, SCATTERED, chosen, chosen.shape[0], csg, camera, plan, terrains)
    if coloured:
        lit_row(work, ONE, y, csg, materials, plan, tracing[0], tracing[1], terrains)
    else:
        colour_row(work, ONE, 0, y, csg, materials, plan, tracing[0], tracing[1], terrains, coloured)


@kernel
def write_colour(target, row, column, red, green, blue):
    """One pixel of the image, and of its radiance where that is wanted."""
    target.image[row, column, 0], target.image[row, column, 1], target.image[row, column, 2] = (
        byte(red),
        byte(green),
        byte(blue),
    )
    if target.radiance.shape[0] > 0:
        target.radiance[row, column, 0] = red
        target.radiance[row, column, 1] = green
        target.radiance[row, column, 2] = blue


@kernel
def mean_colour(row, column, samples, csg, camera, materials, plan, work, tracing, terrains, raw):
    """The weighted mean of the colours of samples (du, dv, weight), pixels from the centre of a raw pixel."""
    s = work.row
    red, green, blue = 0.0, 0.0, 0.0
    for k in range(samples.shape[0]):
        x, y = raw_sample(raw.rays, row, column, samples[k, 0], samples[k, 1])
        shoot(x, y, csg, camera, materials, plan, work, tracing, terrains, raw, samples.shape[0] > 0)
        red += samples[k, 2] * s[RED]
        green += samples[k, 2] * s[GREEN]
        blue += samples[k, 2] * s[BLUE]
    return red, green, blue


@njit(error_model='numpy', nogil=True)
def render_raw_rows(rows, samples, csg, camera, materials, plan, target, work, tracing, terrains, object_of, raw):
    """Render some rows: first, step. The target holds background.

    samples : (n, 3), see mean_colour; (0, 3) for the ray through the centre alone
    """
    s = work.row
    height, width = target.depth.shape
    for row in range(rows[0], height, rows[1]):
        if work.counts[3] != 0:
            return
        for column in range(width):
            x, y = raw.rays[row + 1, column + 1, 0], raw.rays[row + 1, column + 1, 1]
            if math.isnan(x) or math.isnan(y):
                write_colour(target, row, column, 0.0, 0.0, 0.0)
                continue
            single = samples.shape[0] == 0
            shoot(x, y, csg, camera, materials, plan, work, tracing, terrains, raw, single)
            write_truth(s, ONE, row, column, target, object_of)
            red, green, blue = s[RED], s[GREEN], s[BLUE]
            if not single:
                red, green, blue = mean_colour(
                    row, column, samples, csg, camera, materials, plan, work, tracing, terrains, raw
                )
            write_colour(target, row, column, red, green, blue)


@njit(error_model='numpy', nogil=True)
def smooth_raw_rows(rows, samples, csg, camera, materials, plan, target, work, tracing, terrains, raw):
    """Anti-alias the pixels where faces meet in some rows: first, step. All of the target is rendered."""
    height, width = target.depth.shape
    for row in range(rows[0], height, rows[1]):
        if work.counts[3] != 0:
            return
        for column in range(width):
            if math.isnan(raw.rays[row + 1, column + 1, 0]) or not on_boundary(target, row, column):
                continue
            red, green, blue = mean_colour(
                row, column, samples, csg, camera, materials, plan, work, tracing, terrains, raw
            )
            write_colour(target, row, column, red, green, blue)


@kernel
def distorted(x, y, lens):
    """Where the raw camera sees the place (x, y) of the ideal image plane; NaN where it does not (LensDistortion)."""
    k = lens.coefficients
    square = x * x + y * y
    if square > lens.widest * lens.widest:
        return math.nan, math.nan
    if lens.equidistant:
        radius = math.sqrt(square)
        if radius == 0.0:
            return x, y
        angle = math.atan(radius)
        a = angle * angle
        stretch = angle * (1.0 + a * (k[0] + a * (k[1] + a * (k[2] + a * k[3])))) / radius
        return x * stretch, y * stretch
    radial = (1.0 + square * (k[0] + square * (k[1] + square * k[4]))) / (
        1.0 + square * (k[5] + square * (k[6] + square * k[7]))
    )
    return (
        x * radial + 2.0 * k[2] * x * y + k[3] * (square + 2.0 * x * x),
        y * radial + k[2] * (square + 2.0 * y * y) + 2.0 * k[3] * x * y,
    )


@njit(error_model='numpy', nogil=True)
def add_light(light, samples, raw, lens, total):
    """Add the light of samples to the raw pixels that their cells lie in, each as much as lies there.

    light : (h, w, 3), what the ideal camera ``samples`` sees. samples, raw : fx, fy, cx, cy, pixels. lens : a Lens.
    total : (raw height, raw width, 4), sums of red, green and blue, each times an area, and of the areas
    """
    height, width = total.shape[:2]
    rows, columns = light.shape[:2]
    # Places of the pixels of three rows, with one more at each end.
    places = np.empty((3, columns + 2, 2))
    for row in range(-1, rows + 1):
        y = (row - samples[3]) / samples[1]
        for column in range(-1, columns + 1):
            u, v = distorted((column - samples[2]) / samples[0], y, lens)
            places[(row + 1) % 3, column + 1, 0] = raw[0] * u + raw[2]
            places[(row + 1) % 3, column + 1, 1] = raw[1] * v + raw[3]
        if row < 1:
            continue
        # The cells of the row before this one: they end half way to their neighbours.
        above, here, below = places[(row - 1) % 3], places[row % 3], places[(row + 1) % 3]
        for j in range(1, columns + 1):
            across, down = 0.5 * abs(here[j + 1, 0] - here[j - 1, 0]), 0.5 * abs(below[j, 1] - above[j, 1])
            if not (across < LARGEST_CELL and down < LARGEST_CELL):
                continue  # also where one of them is NaN
            left, top = here[j, 0] - 0.5 * across, here[j, 1] - 0.5 * down
            right, bottom = left + across, top + down
            # Pixel u is what lies between u - 0.5 and u + 0.5.
            u0, u1 = max(int(math.floor(left + 0.5)), 0), min(int(math.floor(right + 0.5)), width - 1)
            v0, v1 = max(int(math.floor(top + 0.5)), 0), min(int(math.floor(bottom + 0.5)), height - 1)
            for v in range(v0, v1 + 1):
                high = min(bottom, v + 0.5) - max(top, v - 0.5)
                for u in range(u0, u1 + 1):
                    area = high * (min(right, u + 0.5) - max(left, u - 0.5))
                    if area > 0.0:
                        total[v, u, 0] += area * light[row - 1, j - 1, 0]
                        total[v, u, 1] += area * light[row - 1, j - 1, 1]
                        total[v, u, 2] += area * light[row - 1, j - 1, 2]
                        total[v, u, 3] += area
