"""Compiled directions of light: random numbers of a ray, lights with a size, matt surfaces and GGX metal.

Random numbers are hashes of where a ray passes its pixel, so that every run, thread and engine has the same ones. The
samples of a place are points of the sequence R2 from a random start: evenly spread, and different from pixel to pixel.
"""

from __future__ import annotations

import math

import numpy as np

from ..settings import ALBEDO_STEPS, R2
from .rows import kernel

# Constants of SplitMix64 (Steele et al. 2014).
GAMMA, FIRST, SECOND = (np.uint64(c) for c in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
HASH = 2.0**-53
R2_U, R2_V = R2
TURN = 2.0 * math.pi


@kernel
def mixed(key, stream):
    """Another whole number below 2^53, as a float, from one such and from the number of a stream."""
    z = np.uint64(key) + (np.uint64(stream) + np.uint64(1)) * GAMMA
    z = (z ^ (z >> np.uint64(30))) * FIRST
    z = (z ^ (z >> np.uint64(27))) * SECOND
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11))


@kernel
def sample(key, stream, k):
    """The k-th of the pairs of numbers in [0, 1) of a ray's key and a stream."""
    u = mixed(key, 2 * stream) * HASH + k * R2_U
    v = mixed(key, 2 * stream + 1) * HASH + k * R2_V
    return u - math.floor(u), v - math.floor(v)


@kernel
def basis(nx, ny, nz):
    """Two unit vectors across a unit vector and each other (Duff et al. 2017)."""
    sign = math.copysign(1.0, nz)
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@kernel
def turned(nx, ny, nz, x, y, z):
    """A direction from the frame whose z is the unit vector n."""
    ax, ay, az, bx, by, bz = basis(nx, ny, nz)
    return ax * x + bx * y + nx * z, ay * x + by * y + ny * z, az * x + bz * y + nz * z


@kernel
def to_ball(dx, dy, dz, distance, radius, u, v):
    """A direction to a ball, evenly over the cone that it fills, and how far its surface is.

    d : unit, towards its middle at this distance.
    """
    sine = min(radius / distance, 1.0)
    least = math.sqrt(1.0 - sine * sine)
    cosine = 1.0 - u * (1.0 - least)
    across = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    x, y, z = turned(dx, dy, dz, across * math.cos(TURN * v), across * math.sin(TURN * v), cosine)
    half = radius * radius - distance * distance * across * across
    return x, y, z, distance * cosine - math.sqrt(max(half, 0.0))


@kernel
def from_matt(nx, ny, nz, u, v):
    """A direction about a normal, as often as its cosine, and that cosine."""
    across, cosine = math.sqrt(u), math.sqrt(1.0 - u)
    x, y, z = turned(nx, ny, nz, across * math.cos(TURN * v), across * math.sin(TURN * v), cosine)
    return x, y, z, cosine


@kernel
def masking(cosine, alpha):
    """Smith's Lambda of GGX: 1 / (1 + Lambda) of the facets are seen from a direction."""
    return 0.5 * (math.sqrt(1.0 + alpha * alpha * (1.0 / (cosine * cosine) - 1.0)) - 1.0)


@kernel
def facets(cosine, alpha):
    """GGX' density of facets at an angle to the normal, 1/sr (Walter et al. 2007)."""
    slant = cosine * cosine * (alpha * alpha - 1.0) + 1.0
    return alpha * alpha / (math.pi * slant * slant)


@kernel
def towards_five(cosine):
    """Schlick's (1 - cosine)^5."""
    rest = 1.0 - min(max(cosine, 0.0), 1.0)
    return rest * rest * rest * rest * rest


@kernel
def albedo(table, cosine, alpha):
    """How much a rough white metal returns at one reflection (surface_data.albedo_table)."""
    last = ALBEDO_STEPS - 1
    y, x = min(max(alpha, 0.0), 1.0) * last, min(max(cosine, 0.0), 1.0) * last
    i, j = min(int(y), last - 1), min(int(x), last - 1)
    fy, fx = y - i, x - j
    return (1.0 - fy) * ((1.0 - fx) * table[i, j] + fx * table[i, j + 1]) + fy * (
        (1.0 - fx) * table[i + 1, j] + fx * table[i + 1, j + 1]
    )


@kernel
def glint(nl, nv, nh, alpha):
    """What a white metal returns of a light of 1, as a matt white surface returns the cosine ``nl``.

    nl, nv, nh : cosines of light, viewer and the direction half way between them to the normal.
    """
    if nl <= 0.0 or nv <= 0.0:
        return 0.0
    seen = 1.0 + masking(nl, alpha) + masking(nv, alpha)
    return math.pi * facets(nh, alpha) / (4.0 * nv * seen)


@kernel
def from_metal(nx, ny, nz, vx, vy, vz, alpha, u, v):
    """A direction in which rough metal mirrors a viewing ray v, by the facets that are seen (Dupuy and Benyoub 2023).

    Returns the direction, its share G2 / G1 (0: it goes inside), the cosine on the facet, and its density, 1/sr.
    """
    ax, ay, az, bx, by, bz = basis(nx, ny, nz)
    # The viewer, in the frame of the normal.
    x, y, z = -(ax * vx + ay * vy + az * vz), -(bx * vx + by * vy + bz * vz), -(nx * vx + ny * vy + nz * vz)
    z = max(z, 1e-6)
    sx, sy, sz = alpha * x, alpha * y, z
    scale = 1.0 / math.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx * scale, sy * scale, sz * scale
    up = (1.0 - v) * (1.0 + sz) - sz
    across = math.sqrt(max(1.0 - up * up, 0.0))
    hx, hy, hz = alpha * (across * math.cos(TURN * u) + sx), alpha * (across * math.sin(TURN * u) + sy), up + sz
    scale = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
    hx, hy, hz = hx * scale, hy * scale, hz * scale
    along = x * hx + y * hy + z * hz
    lx, ly, lz = 2.0 * along * hx - x, 2.0 * along * hy - y, 2.0 * along * hz - z
    if lz <= 0.0:
        return nx, ny, nz, 0.0, 0.0, 1.0
    seen = 1.0 + masking(z, alpha)
    density = facets(hz, alpha) / (4.0 * z * seen)
    dx, dy, dz = ax * lx + bx * ly + nx * lz, ay * lx + by * ly + ny * lz, az * lx + bz * ly + nz * lz
    return dx, dy, dz, seen / (seen + masking(lz, alpha)), along, density
