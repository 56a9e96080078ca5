"""How surely an interpretation is no accident, in nats: the logarithm of a ratio of probabilities.

Clutter is not made of independent pieces. It consists of objects, most of them regular: their edges are parallel or at
right angles, meet in corners and lie in common planes. A pose that lays one corner of a model on the corner of a box
explains three edges for nothing, and five or nine when one or two dimensions happen to agree. So it is not matched
features that count but coincidences, beyond those that made the pose:

    offsets    a matched feature lies in planes (see regularity.py) that matched directions span or are upright to. A
               plane in which a matched feature lies already is free, and so are the first three that fix the position.
               Each other one is a coincidence, whose chance is the share of all offsets that lie within the tolerance
               of one of the model's
    directions a direction that is neither parallel nor perpendicular to those before: each free angle, whose chance is
               ANGLE for each direction that the model has
    radii      each distinct radius: the chance that one of another object lies within the tolerance of the model's
    turn       features that are all parallel leave the turn about their direction to an offset, which then is none
    displaced  a curve that the model has elsewhere, where nothing was found, shows another object: what it would count
               for at its place counts against the pose
    accuracy   by chance a plane lies anywhere within the tolerance of the model's; when it is the model's it lies
               within its error, which is the smaller the more data there is in it, and BIAS x tolerance
    coverage   a model edge covered to COVERED of its length has chance WHOLE in the model, and in the data the share of
               pieces of that length among those that would fit the edge. Equal parallel edges count once
    view       more of the model is found, and less is missed, than by chance, see visibility_evidence.py
    neighbours an object's edges meet at their ends. Unexplained data that meet the explained data, end to end, speak
               for another object: a chance pose has some (NEIGHBOURS) besides those that density explains and those
               that noise takes from the model itself, and counts are as likely as Poisson says. Data that run into the
               middle of an edge tell nothing, as print and what stands behind do. A share of real objects (crowded) has
               patterns at its edges, or stands on others, and has neighbours like a chance pose
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from ..geometry.features import CURVE, DataFeatures, ModelFeatures
from ..geometry.line_pairs import pair_geometry
from ..geometry.rigid_motion import inverse_rotate, inverse_transform, transform
from ..geometry.settings import PARALLEL_SINE
from ..model.regularity import Regularity
from ..model.settings import PARALLEL_COSINE, PERPENDICULAR_COSINE
from .settings import (
    ANGLE,
    BIAS,
    COVERED,
    FIXING_SINE,
    FRAGMENTS,
    NEIGHBOURHOOD,
    NEIGHBOURS,
    PER_OFFSET,
    RADII,
    REACH,
    SAME_LENGTH,
    SHORT,
    WHOLE,
    WORST,
)
from .visibility_evidence import count_in_view, nats_of_view


class Planes(NamedTuple):
    """The planes of the usual orientations that a model's e features lie in, under a tolerance.

    Attributes
    ----------
    number : (q, e) int32
        Of the plane of each orientation that a feature lies in, -1 for none.
    nats : (q,)
        Of a chance coincidence with one of them.
    """

    number: Int32Array
    nats: FloatArray


@njit
def plane_table(offsets: FloatArray, by_offset: Int32Array, tolerance: float) -> Planes:
    """Number the planes that a model's features lie in.

    Offsets within twice the tolerance cannot be told apart. The offset of a plane of another object lies anywhere in
    twice the model's extent.

    Parameters
    ----------
    offsets, by_offset : (q, e)
        Of the model's :class:`.Regularity`, offsets and sorted.
    tolerance : float
        Metres.

    Returns
    -------
    Planes

    """
    q, e = offsets.shape
    number = np.full((q, e), -1, np.int32)
    nats = np.zeros(q)
    for i in range(q):
        count = -1
        covered = 2.0 * tolerance
        first = last = anchor = 0.0
        for k in range(e):
            j = by_offset[i, k]
            value = offsets[i, j]
            if np.isnan(value):
                break
            if count < 0:
                first = last = anchor = value
                count = 0
            elif value - anchor > 2.0 * tolerance:
                count += 1
                anchor = value
            covered += min(value - last, 2.0 * tolerance)
            last = value
            number[i, j] = count
        nats[i] = -np.log(min(covered / (2.0 * (last - first) + 2.0 * tolerance), 0.9))
    return Planes(number, nats)


@njit
def _remainder(vector: FloatArray, basis: FloatArray, count: int, out: FloatArray) -> float:
    """Length of a vector's part outside the span of the first ``count`` orthonormal rows of ``basis``."""
    x, y, z = vector[0], vector[1], vector[2]
    for b in range(count):
        dot = x * basis[b, 0] + y * basis[b, 1] + z * basis[b, 2]
        x, y, z = x - dot * basis[b, 0], y - dot * basis[b, 1], z - dot * basis[b, 2]
    out[0], out[1], out[2] = x, y, z
    length: float = np.sqrt(x * x + y * y + z * z)
    return length


@njit
def free_angles(u: FloatArray, earlier: FloatArray, count: int) -> int:
    """Angles of a direction that regularity does not explain: 0, 1 or 2; the first direction's are the pose's own."""
    if count == 0:
        return 0
    least = 2
    for a in range(count):
        v = earlier[a]
        if abs(u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) < PERPENDICULAR_COSINE:
            least = min(least, 1)
        for b in range(a):
            w = earlier[b]
            x, y, z = v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]
            length = np.sqrt(x * x + y * y + z * z)
            if length < PERPENDICULAR_COSINE:
                continue
            c = abs(x * u[0] + y * u[1] + z * u[2]) / length
            if c > PARALLEL_COSINE:
                return 0
            if c < PERPENDICULAR_COSINE:
                least = min(least, 1)
    return least - 1 if count == 1 else least


@njit
def regular_planes(used: BoolArray, regular: Regularity) -> BoolArray:
    """Which orientations of planes an object with these model features owes to its regularity.

    They are spanned by directions of the features ``used`` (e,) bool, and of those upright to two of them. A slanted
    plane through two edges is none while nothing slanted is matched. Of a single direction all are that it lies in.
    Returns (q,) bool.
    """
    direction, usual, spanned, upright = regular.direction, regular.usual, regular.spanned, regular.upright
    q, d = spanned.shape
    seen = np.zeros(d, np.bool_)
    for k in range(d):
        for j in range(len(used)):
            if used[j] and direction[j] == usual[k]:
                seen[k] = True
                break
    least = min(seen.sum(), 2)
    derived = seen.copy()
    for a in range(d):
        for b in range(a):
            if seen[a] and seen[b] and upright[a, b] >= 0:
                derived[upright[a, b]] = True
    owed = np.zeros(q, np.bool_)
    for i in range(q):
        within = found = 0
        for k in range(d):
            if spanned[i, k] == 1:
                within += 1
                found += derived[k]
            elif spanned[i, k] == 2 and derived[k]:
                owed[i] = True
        if found >= min(within, least):
            owed[i] = True
    return owed


@njit
def radius_nats(radius: float, room: float) -> float:
    """Nats of a radius (metres) of another object that comes within so much (metres) of it by chance.

    Radii of things are as frequent from 2 to 4 mm as from 20 to 40: the chance is the share of the logarithms of RADII.

    Examples
    --------
    >>> round(radius_nats(0.02, 0.002), 2)
    2.83
    """
    if room >= radius:
        return 0.0
    share = np.log((radius + room) / (radius - room)) / np.log(RADII)
    return float(-np.log(min(share, 1.0)))


@njit
def _is_new(radius: float, radii: FloatArray, count: int) -> bool:
    """Whether a radius (metres) is none of the first ``count`` radii."""
    new = True
    for r in range(count):
        new = new and abs(radii[r] - radius) > SAME_LENGTH * radius
    return new


@njit
def _next_plane(
    j: int,
    planes: Planes,
    owed: BoolArray,
    known: BoolArray,
    normals: FloatArray,
    fixed: FloatArray,
    n_fixed: int,
    placed: FloatArray,
    n_placed: int,
    rest: FloatArray,
) -> tuple[int, float]:
    """Of the unknown planes of feature j those first that only fix the position, then the likeliest coincidence.

    fixed, placed : orthonormal rows, the directions that are fixed for the feature and for the whole model; rest : (3,)
    scratch space
    Returns its number, -1 when none is left, and its nats, -1 when it only fixes the position.
    """
    best, least = -1, np.inf
    for i in range(len(owed)):
        if not owed[i] or planes.number[i, j] < 0 or known[i, planes.number[i, j]]:
            continue
        if _remainder(normals[i], fixed, n_fixed, rest) <= FIXING_SINE:
            continue
        value = planes.nats[i]
        if n_placed < 3 and _remainder(normals[i], placed, n_placed, rest) > FIXING_SINE:
            value = -1.0
        if value < least:
            best, least = i, value
    return best, least


@njit
def _place_any(placed: FloatArray, count: int, rest: FloatArray) -> int:
    """Add an axis that is not placed yet to the first ``count`` orthonormal rows; returns their new number."""
    for axis in range(3):
        unit = np.zeros(3)
        unit[axis] = 1.0
        length = _remainder(unit, placed, count, rest)
        if length > 0.5:
            placed[count] = rest / length
            return count + 1
    return count


@njit
def _all_parallel(used: BoolArray, direction: Int32Array) -> bool:
    """Whether the features used (e,) have one direction, by the numbers of their directions (e,)."""
    first = -1
    for j in range(len(used)):
        if used[j]:
            if first >= 0 and direction[j] != first:
                return False
            first = direction[j]
    return True


@njit
def _directions_and_radii(model: ModelFeatures, used: BoolArray, regular: Regularity, of_radius: FloatArray) -> float:
    """Nats of the directions and of the distinct radii of the features used (e,); of_radius : (e,) nats of each."""
    rows, direction = model.rows, regular.direction
    seen = np.zeros(len(used), np.bool_)
    directions, radii = np.empty((12, 3)), np.empty(len(used))
    per_angle = -np.log(min(1.0, ANGLE * (direction.max() + 1)))
    n_directions = n_radii = 0
    total = 0.0
    for j in regular.order:
        if not used[j]:
            continue
        if not seen[direction[j]] and n_directions < len(directions):
            seen[direction[j]] = True
            total += per_angle * free_angles(rows[j, 3:6], directions, n_directions)
            directions[n_directions] = rows[j, 3:6]
            n_directions += 1
        if model.kind[j] == CURVE and _is_new(rows[j, 7], radii, n_radii):
            radii[n_radii] = rows[j, 7]
            n_radii += 1
            total += of_radius[j]
    nats: float = total
    return nats


@njit
def coincidences(
    model: ModelFeatures,
    used: BoolArray,
    regular: Regularity,
    planes: Planes,
    accuracy: FloatArray,
    of_radius: FloatArray,
) -> float:
    """Nats of the coincidences beyond the pose among the model features that are explained.

    Parameters
    ----------
    model : ModelFeatures
    used : (e,) bool
        The features.
    regular : Regularity
        Of the model.
    planes : Planes
        Of the model, under the data's tolerance.
    accuracy : (q, e) float64
        Nats to add for each plane. Of parallel planes any one could be the one that fixes the position: it is the most
        accurate, so that what the pose misses counts wherever it is.
    of_radius : (e,) float64
        Nats of the radius of each curve.

    Returns
    -------
    float

    """
    rows, order, normals, number = model.rows, regular.order, regular.normals, planes.number
    q, e = number.shape[0], rows.shape[0]
    owed = regular_planes(used, regular)
    anchor = np.full(q, np.nan)
    known = np.zeros((q, e), np.bool_)
    placed, fixed = np.zeros((3, 3)), np.zeros((3, 3))
    rest = np.zeros(3)
    n_placed = 0
    total = _directions_and_radii(model, used, regular, of_radius)
    turn_is_open = _all_parallel(used, regular.direction)
    for k in range(e):
        j = order[k]
        if not used[j]:
            continue
        freedom = 3 if model.kind[j] == CURVE else 2
        n_fixed = 0
        for i in range(q):
            if owed[i] and number[i, j] >= 0 and known[i, number[i, j]] and n_fixed < freedom:
                length = _remainder(normals[i], fixed, n_fixed, rest)
                if length > FIXING_SINE:
                    fixed[n_fixed] = rest / length
                    n_fixed += 1
        while n_fixed < freedom:
            best, least = _next_plane(j, planes, owed, known, normals, fixed, n_fixed, placed, n_placed, rest)
            if best < 0:
                n_fixed += 1
                if n_placed < 3:
                    n_placed = _place_any(placed, n_placed, rest)
                elif turn_is_open:
                    turn_is_open = False
                else:
                    total += PER_OFFSET
                continue
            along = abs(normals[best, 0] * rows[j, 3] + normals[best, 1] * rows[j, 4] + normals[best, 2] * rows[j, 5])
            if least >= 0.0 and turn_is_open and along < PERPENDICULAR_COSINE:
                turn_is_open = False
            elif least < 0.0:
                length = _remainder(normals[best], placed, n_placed, rest)
                placed[n_placed] = rest / length
                n_placed += 1
                anchor[best] = accuracy[best, number[best, j]]
            else:
                value = accuracy[best, number[best, j]]
                if value > anchor[best]:
                    value, anchor[best] = anchor[best], value
                total += least + value
            known[best, number[best, j]] = True
            length = _remainder(normals[best], fixed, n_fixed, rest)
            fixed[n_fixed] = rest / length
            n_fixed += 1
        for i in range(q):
            if number[i, j] >= 0:
                known[i, number[i, j]] = True
    nats: float = total
    return nats


@njit
def coverage(
    model: ModelFeatures, data: DataFeatures, low: FloatArray, high: FloatArray, direction: Int32Array
) -> float:
    """Nats for the lengths of the pieces found: low, high (e,) metres, what is covered of each model edge."""
    rows = model.rows
    e, n = rows.shape[0], data.rows.shape[0]
    total = 0.0
    for j in range(e):
        if model.kind[j] == CURVE or high[j] <= low[j]:
            continue
        length = 2.0 * rows[j, 6]
        whole = high[j] - low[j] >= COVERED * length
        repeated = False
        for i in range(j):
            same = direction[i] == direction[j] and abs(2.0 * rows[i, 6] - length) < SAME_LENGTH * length
            if same and high[i] > low[i] and (high[i] - low[i] >= COVERED * 2.0 * rows[i, 6]) == whole:
                repeated = True
                break
        if repeated:
            continue
        fitting = alike = 0
        for k in range(n):
            if data.kind[k] != CURVE and 2.0 * data.rows[k, 6] <= (1.0 + SAME_LENGTH) * length:
                fitting += 1
                if 2.0 * data.rows[k, 6] >= COVERED * length:
                    alike += 1
        chance = (alike + 1.0) / (fitting + 4.0)
        total += np.log(WHOLE / chance) if whole else np.log((1.0 - WHOLE) / (1.0 - chance))
    return total


@njit
def meet(a: FloatArray, b: FloatArray, tolerance: float) -> bool:
    """Whether two edges (rows) meet end to end: their lines within the tolerance (metres), near an end of both."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    reach = (1.0 + 2.0 * REACH) * (a[6] + b[6]) + 6.0 * tolerance
    if x * x + y * y + z * z > reach * reach:
        return False
    _, s, d, fa, fb, _ = pair_geometry(a, b)
    if s < PARALLEL_SINE or abs(d) > tolerance:
        return False
    beyond = tolerance / s
    near_ends: bool = (
        abs(abs(fa) - a[6]) < 2.0 * REACH * a[6] + beyond and abs(abs(fb) - b[6]) < 2.0 * REACH * b[6] + beyond
    )
    return near_ends


class Surroundings(NamedTuple):
    """What lies about the data that a pose explains.

    Attributes
    ----------
    matched
        Data features that it explains.
    met
        Unexplained edges that meet these end to end.
    by_density
        How many would meet them if all that is unexplained were strewn about.
    """

    matched: float
    met: float
    by_density: float


@njit
def surroundings(motion: FloatArray, model: ModelFeatures, data: DataFeatures, assignment: Int32Array) -> Surroundings:
    """Count what lies about the data that a pose explains.

    Parameters
    ----------
    motion : (12,) float64
        The pose.
    model : ModelFeatures
    data : DataFeatures
    assignment : (n,) int32
        The model feature of each data feature, negative for none.

    Returns
    -------
    Surroundings

    """
    rows, tols, middle, size = data.rows, data.tolerances, model.middle, model.size
    n = rows.shape[0]
    cx, cy, cz = transform(motion, middle[0], middle[1], middle[2])
    radius = NEIGHBOURHOOD * size
    matched = np.empty(n, np.int64)
    count = 0
    explained = unexplained = tolerance = 0.0
    for k in range(n):
        if assignment[k] >= 0:
            matched[count] = k
            count += 1
            explained += 2.0 * rows[k, 6]
            tolerance += tols[k, 0]
    if count == 0:
        return Surroundings(0.0, 0.0, 0.0)
    tolerance /= count
    met = 0.0
    for k in range(n):
        if assignment[k] >= 0 or data.kind[k] == CURVE or 2.0 * rows[k, 6] < SHORT * tols[k, 0]:
            continue
        x, y, z = rows[k, 0] - cx, rows[k, 1] - cy, rows[k, 2] - cz
        away = np.sqrt(x * x + y * y + z * z)
        if away < radius:
            unexplained += 2.0 * rows[k, 6]
        elif away > size + (1.0 + 2.0 * REACH) * rows[k, 6]:
            continue
        for i in range(count):
            a = matched[i]
            if data.kind[a] != CURVE and meet(rows[k], rows[a], 0.5 * (tols[k, 0] + tols[a, 0])):
                met += 1.0
                break
    # Two of the straight pieces strewn over a volume meet with this chance (Crofton).
    density = explained * unexplained * 0.5 * np.pi * tolerance / (4.0 / 3.0 * np.pi * radius**3)
    return Surroundings(float(count), met, density)


@njit
def neighbours(around: Surroundings) -> float:
    """Nats for what surrounds the data that a pose explains."""
    if around.matched == 0.0:
        return 0.0
    expected = NEIGHBOURS.at_ends * around.by_density + NEIGHBOURS.missed * around.matched + 0.05
    alone = np.exp(NEIGHBOURS.of_chance - around.met * np.log((expected + NEIGHBOURS.of_chance) / expected))
    nats: float = np.log((1.0 - NEIGHBOURS.crowded) * alone + NEIGHBOURS.crowded)
    return nats


@njit
def _on_face(
    middle: tuple[float, ...],
    normal: tuple[float, ...],
    radius: float,
    faces: FloatArray,
    tolerances: tuple[float, float],
) -> bool:
    """Whether the whole of a curve lies on a face (h, 4) of a hull.

    middle, normal, radius : of the curve, model frame; tolerances : of its radius, and across
    """
    on, (room, across) = False, tolerances
    for h in range(len(faces)):
        f = faces[h]
        above = f[0] * middle[0] + f[1] * middle[1] + f[2] * middle[2] + f[3]
        cosine = abs(f[0] * normal[0] + f[1] * normal[1] + f[2] * normal[2])
        upright = cosine > PARALLEL_COSINE
        # Its farthest point goes beyond the face in which it lies by its own error only.
        if above > across or (not upright and above + radius * np.sqrt(1.0 - cosine * cosine) > room):
            return False
        on = on or (upright and above >= -across)
    return on


@njit
def displaced(
    motion: FloatArray,
    model: ModelFeatures,
    data: DataFeatures,
    assignment: Int32Array,
    used: BoolArray,
    faces: FloatArray,
) -> float:
    """Nats against a pose for a curve that is not where the model has it.

    An unexplained curve that has the radius of a model curve which was not found, and lies beside it, so near that both
    cannot be there, or on a face of the model's hull where there is none, would be one of clutter by chance only; on
    another object that is like the model it is to be expected. But a curve that was found casts a shadow of its radius
    on faces and tables that are parallel to it, and where it is there is no other.

    Parameters
    ----------
    motion : (12,) float64
        The pose.
    model : ModelFeatures
    data : DataFeatures
    assignment : (n,) int32
        The model feature of each data feature, negative for none.
    used : (e,) bool
        The model features that were found.
    faces : (h, 4) float64
        Of the model's hull, see :func:`.convex_hull.hull_faces`.

    Returns
    -------
    float
        Of the curve that counts most; 0 when there is none.

    """
    worst = 0.0
    for k in range(len(assignment)):
        if assignment[k] >= 0 or data.kind[k] != CURVE:
            continue
        d, across = data.rows[k], data.tolerances[k, 0]
        room = data.radius_tolerance + across
        x, y, z = inverse_transform(motion, d[0], d[1], d[2])
        u, v, w = inverse_rotate(motion, d[3], d[4], d[5])
        if _of_found((x, y, z), (u, v, w), d[7], model, used, (room, across)):
            continue
        on_face = _on_face((x, y, z), (u, v, w), d[7], faces, (room, across))
        for j in range(len(used)):
            m = model.rows[j]
            if used[j] or model.kind[j] != CURVE or abs(d[7] - m[7]) > room:
                continue
            upright, beside = _beside((x, y, z), m)
            overlaps = abs(upright) <= across and 2.0 * across < beside < d[7] + m[7]
            overlaps = overlaps and abs(u * m[3] + v * m[4] + w * m[5]) > PARALLEL_COSINE
            elsewhere = on_face and (abs(upright) > 2.0 * across or beside > 2.0 * across)
            if overlaps or elsewhere:
                in_plane = -np.log(min(2.0 * across / model.size, 1.0))
                worst = max(worst, radius_nats(m[7], room) + in_plane)
    return worst


@njit
def _of_found(
    middle: tuple[float, ...],
    normal: tuple[float, ...],
    radius: float,
    model: ModelFeatures,
    used: BoolArray,
    tolerances: tuple[float, float],
) -> bool:
    """Whether a curve may be one that was found: as large, and parallel to it.

    In another plane it is its shadow, by a light far off; in its own, where both cannot be, it is that one, measured
    wrongly.

    middle, normal, radius : of the curve, model frame; tolerances : of its radius, and across
    """
    room, across = tolerances
    for j in range(len(used)):
        m = model.rows[j]
        if not used[j] or model.kind[j] != CURVE or abs(radius - m[7]) > room:
            continue
        if abs(normal[0] * m[3] + normal[1] * m[4] + normal[2] * m[5]) < PARALLEL_COSINE:
            continue
        upright, beside = _beside(middle, m)
        if abs(upright) > 2.0 * across or beside < radius + m[7]:
            return True
    return False


@njit
def _beside(middle: tuple[float, ...], m: FloatArray) -> tuple[float, float]:
    """How far a place is from the plane of a curve (9,), with its sign, and from its axis, metres."""
    x, y, z = middle[0] - m[0], middle[1] - m[1], middle[2] - m[2]
    upright = x * m[3] + y * m[4] + z * m[5]
    return upright, np.sqrt(max(x * x + y * y + z * z - upright * upright, 0.0))


@njit
def evidence(
    motion: FloatArray,
    model: ModelFeatures,
    data: DataFeatures,
    assignment: Int32Array,
    regular: Regularity,
    planes: Planes,
) -> float:
    """Evidence of one pose with its assignment.

    Parameters
    ----------
    motion : (12,) float64
        The pose.
    model : ModelFeatures
    data : DataFeatures
    assignment : (n,) int32
        The model feature of each data feature, negative for none.
    regular : Regularity
        Of the model.
    planes : Planes
        Of the model, under the data's tolerance.

    Returns
    -------
    float
        Nats.

    """
    e, n = model.rows.shape[0], data.rows.shape[0]
    number, normals = planes.number, regular.normals
    low = np.full(e, np.inf)
    high = np.full(e, -np.inf)
    used = np.zeros(e, np.bool_)
    accuracy, sums, weights = np.zeros(number.shape), np.zeros(number.shape), np.zeros(number.shape)
    of_radius, off, curves = np.zeros(e), np.zeros(e), np.zeros(e)
    room = np.zeros(e)
    squares = 0.0
    point = np.empty(3)
    for k in range(n):
        j = assignment[k]
        if j < 0:
            continue
        used[j] = True
        m, d = model.rows[j], data.rows[k]
        curve = data.kind[k] == CURVE
        if curve:
            off[j] += d[7] - m[7]
            curves[j] += 1.0
            room[j] = max(room[j], data.radius_tolerance + data.tolerances[k, 0])
        for end in range(1 if curve else 2):
            step = 0.0 if curve else d[6] if end == 0 else -d[6]
            point[:] = inverse_transform(motion, d[0] + step * d[3], d[1] + step * d[4], d[2] + step * d[5])
            along = 0.0
            for axis in range(3):
                point[axis] -= m[axis]
                along += point[axis] * m[3 + axis]
            if not curve:
                low[j], high[j] = min(low[j], along), max(high[j], along)
                for axis in range(3):
                    point[axis] -= along * m[3 + axis]
            for i in range(number.shape[0]):
                if number[i, j] >= 0:
                    r = point[0] * normals[i, 0] + point[1] * normals[i, 1] + point[2] * normals[i, 2]
                    r /= data.tolerances[k, 0]
                    sums[i, number[i, j]] += r
                    weights[i, number[i, j]] += 1.0
                    squares += r * r
    points = distinct = 0.0
    for i in range(number.shape[0]):
        for p in range(e):
            if weights[i, p] > 0.0:
                points += weights[i, p]
                distinct += 1.0
                squares -= sums[i, p] ** 2 / weights[i, p]
    variance = min(max(squares, 0.01 * points) / max(points - distinct, 1.0), 0.25)
    for i in range(number.shape[0]):
        for p in range(e):
            if weights[i, p] > 0.0:
                error = variance / weights[i, p] + BIAS**2
                excess = (sums[i, p] / weights[i, p]) ** 2 / error
                accuracy[i, p] = max(0.5 * (np.log(2.0 / (np.pi * error)) - excess), -WORST)
    for j in range(e):
        if curves[j] > 0.0:
            # A radius errs as its centre does.
            tolerance = room[j] - data.radius_tolerance
            error = variance * (tolerance / room[j]) ** 2 / curves[j] + BIAS**2
            excess = (off[j] / curves[j] / room[j]) ** 2 / error
            fit = max(0.5 * (np.log(2.0 / (np.pi * error)) - excess), -WORST)
            of_radius[j] = radius_nats(model.rows[j, 7], room[j]) + fit
    total = coincidences(model, used, regular, planes, accuracy, of_radius)
    total -= displaced(motion, model, data, assignment, used, regular.faces)
    total += max(coverage(model, data, low, high, regular.direction), FRAGMENTS)
    total += nats_of_view(count_in_view(motion, used, regular.faces, regular.lies))
    nats: float = total + neighbours(surroundings(motion, model, data, assignment))
    return nats
