"""Grey levels across an outline, and the step fitted to them: compiled loops."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import ByteArray, FloatArray, Int32Array, IntArray

from ..geometry.least_squares import cholesky
from ..geometry.settings import UNIFORM_VARIANCE
from .blurred_root import blurred_root
from .settings import CONTRAST, FARTHEST_STEP, FIT_TURNS, FLANK, LAST_FIT_GAIN, LONGEST_FIT_STEP, ON_EDGE

# The fourth cumulant of what is spread evenly over one.
EVEN_CUMULANT = -1.0 / 120.0
# Numbers of a fitted step, see fit_profiles.
FITTED = 8


class Stretches(NamedTuple):
    """Short stretches of an outline in one image.

    Attributes
    ----------
    pixel, normal : (n, 2) float64
        Middles and unit normals, pixels.
    spacing : (n,) float64
        Pixels, their lengths.
    bend : (n,) float64
        Their curvatures, towards the normal, one over pixels.
    limb : (n,) float64
        1 or -1: the side, along the normal, on which a curved surface turns away from the eye; 0 where none does.
    flank : (n,) int32
        Pixels to either side that nothing else of the outline crosses but what runs beside it; 0: there is no room.
    together : (n,) float64
        Points of the same curve: along it shade has one slope, of which each knows so little more beforehand.
    """

    pixel: FloatArray
    normal: FloatArray
    spacing: FloatArray
    bend: FloatArray
    limb: FloatArray
    flank: Int32Array
    together: FloatArray

    def some(self, rows: IntArray) -> Stretches:
        """Some of them."""
        pixel, normal, spacing, bend, limb, flank, together = self
        return Stretches(pixel[rows], normal[rows], spacing[rows], bend[rows], limb[rows], flank[rows], together[rows])


class Quality(NamedTuple):
    """What an image is like.

    Attributes
    ----------
    tone : float
        Exponent that makes light of grey levels: what is blurred is light, not its code.
    blur : float
        Pixels, sigma, of the image on its pixels.
    noise : float
        Grey levels, sigma, of a pixel.
    walk : float
        Grey levels for a root of a pixel, sigma: by how much shade, print and grain make the levels beside a step
        wander.
    slope : float
        Grey levels a pixel, sigma of the slopes that shade may have beside a step.
    """

    tone: float
    blur: float
    noise: float
    walk: float
    slope: float


class Profiles(NamedTuple):
    """Grey levels across an outline, and how far from it.

    Attributes
    ----------
    seen : (n, 4, 2 FLANK + 1) float64
        What :func:`pixel_profile` fills for each stretch, in the first columns.
    pixels : (n,) int32
        How many pixels each level is the mean of; 0 where there is no profile.
    """

    seen: FloatArray
    pixels: Int32Array


@njit(nogil=True)
def profiles_of(image: ByteArray, outline: Stretches, tone: float) -> Profiles:
    """The profiles of an outline, in light; tone : see :class:`Quality`."""
    levels = 255.0 * (np.arange(256.0) / 255.0) ** tone
    n = len(outline.spacing)
    seen, pixels = np.empty((n, 4, 2 * FLANK + 1)), np.zeros(n, np.int32)
    for k in range(n):
        r = outline.flank[k]
        at = (outline.pixel[k, 0], outline.pixel[k, 1], outline.normal[k, 0], outline.normal[k, 1])
        if r > 0:
            out = seen[k, :, : 2 * r + 1]
            pixels[k] = pixel_profile(image, levels, at, outline.spacing[k], outline.bend[k], r, out)
    return Profiles(seen, pixels)


@njit(nogil=True)
def pixel_profile(
    image: ByteArray,
    levels: FloatArray,
    at: tuple[float, ...],
    spacing: float,
    bend: float,
    reach: int,
    out: FloatArray,
) -> int:
    """Mean levels of pixels at about one distance from a curve, and what distances these are.

    Pixels are taken as they are: a level looked up between them is that of a wider blur, of a shape of its own, and
    along an edge in the direction of rows all are looked up at the same place. Each column that a stretch crosses (or
    row, where it is steep) gives the pixels about the curve, the first of all columns with the second of all and so on.
    How much their distances differ in a mean blurs it.

    Parameters
    ----------
    image : (h, w) uint8
    levels : (256,) float64
        What each value of a pixel stands for.
    at : tuple of 4 float
        A point of the curve and the unit normal there, pixels.
    spacing : float
        Pixels, length of the stretch.
    bend : float
        Its curvature towards the normal, one over pixels.
    reach : int
        Pixels of a column to either side of the curve.
    out : (4, 2 reach + 1) float64
        Filled, by the distance along the normal: levels, distances (pixels), and the variance and the third central
        moment of the distances (pixels squared and cubed).

    Returns
    -------
    int
        How many pixels each level is the mean of; 0 where not all lie in the image.
    """
    upright = abs(at[2]) > abs(at[3])
    # Along the columns that are crossed, and across; of an edge that is steep in the image, rows are crossed.
    p0, q0, normal_p, normal_q = (at[1], at[0], at[3], at[2]) if upright else (at[0], at[1], at[2], at[3])
    wide, high = (image.shape[0], image.shape[1]) if upright else (image.shape[1], image.shape[0])
    half = 0.5 * spacing * abs(normal_q)
    first, end = math.ceil(p0 - half), math.ceil(p0 + half)
    if end <= first:
        first = round(p0)
        end = first + 1
    if first < 0 or end > wide:
        return 0
    out[:] = 0.0
    count, way = end - first, 1 if normal_q > 0.0 else -1
    # The shift from column to column is counted from the middle: where it is small, all take the same rows.
    middle = _height(0.5 * (first + end - 1) - p0, normal_p, normal_q, bend)
    centre = round(q0 + middle)
    for p in range(first, end):
        dp = p - p0
        q = centre + round(_height(dp, normal_p, normal_q, bend) - middle)
        if q - reach < 0 or q + reach >= high:
            return 0
        for k in range(2 * reach + 1):
            row = q + way * (k - reach)
            dq = row - q0
            along = dp * normal_q - dq * normal_p
            across = dp * normal_p + dq * normal_q - 0.5 * bend * along * along
            out[0, k] += levels[image[p, row] if upright else image[row, p]]
            out[1, k] += across
            out[2, k] += across * across
            out[3, k] += across * across * across
    for k in range(2 * reach + 1):
        for i in range(4):
            out[i, k] /= count
        mean, square = out[1, k], out[2, k]
        out[2, k] = max(square - mean * mean, 0.0)
        out[3, k] += mean * (2.0 * mean * mean - 3.0 * square)
    return count


@njit(nogil=True)
def _height(across: float, normal_p: float, normal_q: float, bend: float) -> float:
    """How far above its point a curve is so many columns on, to second order, pixels."""
    return (0.5 * bend * (across / normal_q) ** 2 - across * normal_p) / normal_q


@njit(nogil=True)
def fit_steps(image: ByteArray, outline: Stretches, beside: FloatArray, quality: Quality, fitted: FloatArray) -> None:
    """The steps of an outline in an image, see :func:`fit_profiles`; ``fitted`` (n, FITTED) is filled."""
    fitted[:] = np.nan
    fit_profiles(profiles_of(image, outline, quality.tone), outline, beside, quality, fitted)


@njit(nogil=True)
def fit_profiles(
    profiles: Profiles, outline: Stretches, beside: FloatArray, quality: Quality, fitted: FloatArray
) -> None:
    """The steps of an outline fitted to the profiles across it: a + sum of b_k Phi((x - o_k - d_k) / blur) + a walk.

    Least squares in contrasts and places. The derivative by a place is largest at its step, so that nothing which white
    noise allows is given away (the maximum of a filter gives up a third). Shade, print and grain make the levels wander
    beside a step, the farther the more: what is far from it says the less of its place. Two things would pull all
    points of a curve to the same side, and are not left to the walk: shade that grows on one side of the step only, of
    which the half that is even about the step, s |x - d_0|, is one more unknown; and noise that a camera cuts off where
    it would be below black or above white, whose mean is taken off the levels.

    Parameters
    ----------
    profiles : Profiles
    outline : Stretches
        The same.
    beside : (n, m, 2) float64
        Pixels from each point to further steps across its normal, o_k, and by how many this changes for each along the
        tangent, in size; not a number where there are fewer.
    quality : Quality
        The tone curve is that of the profiles.
    fitted : (n, FITTED) float64
        Filled with: d_0, pixels along the normal; its variance; the contrast b_0; mean squared residual, in units of
        what noise and walk make it; the slope s; its variance; its covariance with d_0; what a grey level is in light,
        here. Not a number where the profile leaves the image, shows no step or one farther than FARTHEST_STEP away.
        The fit begins with the place, contrast and slope that it holds already.
    """
    tone, blur, noise, walk, slope = quality
    # Of a pixel's noise in light, at either end of the scale.
    black, white = 255.0 * (noise / 255.0) ** tone, tone * noise
    seen = np.empty((5, 2 * FLANK + 1))
    most = 4 + 2 * beside.shape[1]
    x, low = np.empty(most), np.empty((most, most))
    wide = 2 * FLANK + 1
    sums = _Sums(
        np.empty((most, most)),
        np.empty(most),
        np.empty((most + 1, wide)),
        np.empty(most),
        np.empty((2, wide)),
        np.empty((beside.shape[1], 4, wide)),
        np.empty((2, wide)),
    )
    for n in range(len(outline.spacing)):
        place, contrast, shade = fitted[n, 0], fitted[n, 2], fitted[n, 4]
        fitted[n] = np.nan
        r, pixels = outline.flank[n], profiles.pixels[n]
        if pixels == 0:
            continue
        levels_seen = seen[:, : 2 * r + 1]
        levels_seen[:4] = profiles.seen[n, :, : 2 * r + 1]
        steps = _unknowns_of_steps(beside[n, :, 0])
        size = steps + (outline.limb[n] != 0.0) + 1
        mixed = math.sqrt(levels_seen[2].mean() / UNIFORM_VARIANCE)
        # Fourth cumulants of a pixel, a square seen at a slant, and of places spread evenly.
        normal_u, normal_v = outline.normal[n]
        square = (normal_u**4 + normal_v**4) * EVEN_CUMULANT
        for k in range(2 * r + 1):
            spread = EVEN_CUMULANT * (seen[2, k] / UNIFORM_VARIANCE) ** 2
            narrow = 1.0 / math.sqrt(blur * blur + seen[2, k])
            seen[4, k] = (square + spread) * narrow**4 / 24.0
            seen[2, k], seen[3, k] = narrow, seen[3, k] * narrow**3 / 6.0
        # What a grey level of the image is in light, here.
        mean = max(levels_seen[0].mean(), 1.0) / 255.0
        light = tone * mean ** (1.0 - 1.0 / tone)
        variance = (noise * light) ** 2 / pixels
        # From one level to the next, less what a mean of pixels at places so far apart leaves of it.
        wander = (walk * light) ** 2 * (max(abs(normal_u), abs(normal_v)) - mixed / 3.0)
        if outline.limb[n] != 0.0:
            # Shade beside a limb is that of the surface, the same all along.
            wander *= outline.together[n]
        x[:] = 0.0
        if not math.isnan(place):
            x[0], x[1], x[size - 1] = place, contrast, shade
        how = _Fit(
            steps, size, outline.limb[n], variance, wander, slope * light * math.sqrt(outline.together[n]), black, white
        )
        for j in range(steps // 2 - 1):
            turned = UNIFORM_VARIANCE * (beside[n, j, 1] * outline.spacing[n]) ** 2
            _widen(levels_seen[1:], turned, sums.shapes[j])
        squares = _converged(levels_seen, beside[n, :, 0], how, x, low, sums)
        if not abs(x[0]) < FARTHEST_STEP or abs(x[1]) < BOUND_SIGMA * math.sqrt(variance):
            continue
        of_place = sums.right
        of_place[:] = 0.0
        of_place[0] = 1.0
        _solve(low, size, of_place)
        fitted[n, 0], fitted[n, 1] = x[0], of_place[0]
        fitted[n, 4], fitted[n, 5] = x[size - 1], 1.0 / low[size - 1, size - 1] ** 2
        fitted[n, 6], fitted[n, 7] = of_place[size - 1], light
        # Of the slope the levels tell only what was not known beforehand.
        freedom = 2 * r - size + fitted[n, 5] / how.slope**2
        fitted[n, 2], fitted[n, 3] = x[1], squares / max(freedom, 1.0)


@njit(nogil=True)
def _unknowns_of_steps(beside: FloatArray) -> int:
    """Places and contrasts of the steps of a profile: its own, and those beside it (m,)."""
    steps = 2
    for place in beside:
        if math.isnan(place):
            break
        steps += 2
    return steps


@njit(nogil=True)
def _converged(seen: FloatArray, beside: FloatArray, how: _Fit, x: FloatArray, low: FloatArray, sums: _Sums) -> float:
    """Gauss-Newton steps from x (u,), in place; returns the sum of squared residuals there, see _normal_equations.

    low : (u, u), filled with the Cholesky factor of the last normal equations
    """
    _whiten(seen.shape[1], how, sums)
    squares, gradient = 0.0, sums.white
    for turn in range(FIT_TURNS):
        squares = _normal_equations(seen, beside, how, x, sums)
        if not cholesky(sums.normal, how.size, low):
            break
        for i in range(how.size):
            gradient[i] = sums.right[i]
        _solve(low, how.size, sums.right)
        longest = LONGEST_FIT_STEP if turn or x[1] != 0.0 else 0.0
        gain = 0.0
        for i in range(how.size):
            # Before it is cut short: a long step is not the last one, whatever is left of it.
            gain += gradient[i] * sums.right[i]
            if i < how.steps and i % 2 == 0:
                sums.right[i] = min(max(sums.right[i], -longest), longest)
            x[i] += sums.right[i]
        if longest > 0.0 and gain < LAST_FIT_GAIN:
            # So short a step is that of a linear problem.
            squares -= gain
            break
    return squares


class _Fit(NamedTuple):
    """What is fitted to one profile.

    Attributes
    ----------
    steps, size : int
        Unknowns of the steps, place and contrast of each, the point's own first; all unknowns.
    limb : float
        See :class:`Stretches`.
    variance, walk : float
        Of the noise of a level of the profile, and of the walk from one to the next.
    slope : float
        Levels a pixel, sigma of the slope of shade beside the step.
    black, white : float
        Sigmas of a pixel's noise where it is black and where it is white.
    """

    steps: int
    size: int
    limb: float
    variance: float
    walk: float
    slope: float
    black: float
    white: float


class _Sums(NamedTuple):
    """Normal equations of a fit, and what makes them.

    Attributes
    ----------
    normal, right : (u, u), (u,) float64
        Matrix, its lower half, and right side.
    rows : (u + 1, 2 FLANK + 1) float64
        Derivatives of the profile by each unknown, and what remains of it.
    white : (u,) float64
        The row of whitened derivatives before.
    link : (2, 2 FLANK + 1) float64
        See :func:`_whiten`.
    shapes : (m, 4, 2 FLANK + 1) float64
        Of each further step, see :func:`_widen`.
    bell : (2, 2 FLANK + 1) float64
        See :func:`_step_rows`.
    """

    normal: FloatArray
    right: FloatArray
    rows: FloatArray
    white: FloatArray
    link: FloatArray
    shapes: FloatArray
    bell: FloatArray


@njit(nogil=True)
def _whiten(n: int, how: _Fit, sums: _Sums) -> None:
    """How differences of neighbours among n levels are made independent: what the one before counts, and the scale.

    The walk leaves differences apart; noise makes each alike with the next, which has one of its levels with the other
    sign: Cholesky factors of a matrix of three diagonals.
    """
    square, near, scale = 2.0 * how.variance + how.walk, 0.0, 0.0
    for k in range(1, n):
        near = -how.variance * scale
        scale = 1.0 / math.sqrt(square - near * near)
        sums.link[0, k], sums.link[1, k] = near, scale


@njit(nogil=True)
def _step_rows(at: float, contrast: float, seen: FloatArray, rows: FloatArray, bell: FloatArray) -> None:
    """Derivatives of a blurred step at a place, pixels along the normal, by place and by contrast: the two ``rows``.

    The step's shape is the beginning of Edgeworth's series (Cramer 1946, 17.6).

    seen : (4, n) of n levels: where they are, pixels; one over the sigma of their blur; a sixth of its skewness; the
        24th part of its excess, below zero: a pixel is a square
    rows, bell : (2, n or more), filled; bell: exp(-t^2 / 2) and its integral, t sigmas of the blur from the step
    """
    # Two loops, of which the second has no calls: it is done for several levels at once.
    where, narrow, skew, flat = seen[0], seen[1], seen[2], seen[3]
    n = len(where)
    for k in range(n):
        t = (where[k] - at) * narrow[k]
        bell[0, k] = math.exp(-0.5 * t * t)
    for k in range(n):
        t = (where[k] - at) * narrow[k]
        density = 0.3989422804014327 * bell[0, k]
        square = t * t
        cubic = t * (square - 3.0)
        bell[1, k] = _normal_integral(t, bell[0, k])
        rows[1, k] = bell[1, k] - (skew[k] * (square - 1.0) + flat[k] * cubic) * density
        quartic = square * (square - 6.0) + 3.0
        rows[0, k] = -contrast * density * (1.0 + skew[k] * cubic + flat[k] * quartic) * narrow[k]


@njit(nogil=True)
def _widen(shape: FloatArray, variance: float, out: FloatArray) -> None:
    """Fill what :func:`_step_rows` asks for of levels, (4, n), where a variance comes to their blur."""
    for k in range(shape.shape[1]):
        narrow = 1.0 / math.sqrt(1.0 / shape[1, k] ** 2 + variance)
        part = narrow / shape[1, k]
        out[0, k], out[1, k], out[2, k], out[3, k] = shape[0, k], narrow, shape[2, k] * part**3, shape[3, k] * part**4


@njit(nogil=True)
def _normal_equations(seen: FloatArray, beside: FloatArray, how: _Fit, x: FloatArray, sums: _Sums) -> float:
    """Fill the normal equations of a fit at x (u,), in units of noise; returns the sum of squared residuals.

    What is compared are the differences of neighbours, see :func:`_whiten`: the level before all falls out. seen :
    (5, n), the levels, and of each what :func:`_step_rows` asks for.
    """
    normal, right, rows, white = sums.normal, sums.right, sums.rows, sums.white
    steps, size = how.steps, how.size
    n = seen.shape[1]
    e = rows[size]
    for k in range(n):
        e[k] = seen[0, k]
    _step_rows(x[0], x[1], seen[1:], rows[:2], sums.bell)
    for k in range(n):
        # The distance from the step, behind the same blur.
        way = 2.0 * sums.bell[1, k] - 1.0
        rows[size - 1, k] = (seen[1, k] - x[0]) * way + 0.7978845608028654 * sums.bell[0, k] / seen[2, k]
        e[k] -= x[1] * rows[1, k] + x[size - 1] * rows[size - 1, k]
        rows[0, k] -= x[size - 1] * way
    for j in range(2, steps, 2):
        further = j // 2 - 1
        _step_rows(x[j] + beside[further], x[j + 1], sums.shapes[further, :, :n], rows[j : j + 2], sums.bell)
        for k in range(n):
            e[k] -= x[j + 1] * rows[j + 1, k]
    if size > steps + 1:
        # Near the limb of a curved surface its normal, and with it the shading, turns with the root of the distance.
        for k in range(n):
            root, slope = blurred_root(how.limb * (seen[1, k] - x[0]), seen[2, k])
            rows[steps, k] = root
            e[k] -= x[steps] * root
            rows[0, k] -= x[steps] * how.limb * slope
    _without_clipped(seen[0], how, e)
    for i in range(size):
        right[i], white[i] = 0.0, 0.0
        for j in range(i + 1):
            normal[i, j] = 0.0
    squares, e_white = 0.0, 0.0
    for k in range(1, n):
        near, scale = sums.link[0, k], sums.link[1, k]
        e_white = (e[k] - e[k - 1] - near * e_white) * scale
        squares += e_white * e_white
        for i in range(size):
            white[i] = (rows[i, k] - rows[i, k - 1] - near * white[i]) * scale
            right[i] += white[i] * e_white
            for j in range(i + 1):
                normal[i, j] += white[i] * white[j]
    for i in range(size):
        believed = ON_EDGE if i < steps and i % 2 == 0 else (how.slope if i == size - 1 else CONTRAST)
        normal[i, i] += 1.0 / believed**2
        right[i] -= x[i] / believed**2
    return squares


@njit(nogil=True)
def _without_clipped(levels: FloatArray, how: _Fit, e: FloatArray) -> None:
    """Take off residuals (n,), in place, what noise below black or above white has cut off levels (n,)."""
    n = len(levels)
    if levels.min() > BOUND_SIGMA * how.black and levels.max() < 255.0 - BOUND_SIGMA * how.white:
        return
    base = e.mean()
    for _ in range(2):
        clipped = 0.0
        for k in range(n):
            clipped += _clipped(base + levels[k] - e[k], how)
        base = e.mean() - clipped / n
    for k in range(n):
        e[k] -= _clipped(base + levels[k] - e[k], how)


@njit(nogil=True)
def _clipped(light: float, how: _Fit) -> float:
    """By how much the mean of noisy pixels of so much light is off it, where those below 0 and above 255 are cut."""
    low, high = max(light, 0.0) / how.black, max(255.0 - light, 0.0) / how.white
    return float(how.black * _tail_mean(low) - how.white * _tail_mean(high))


@njit(nogil=True)
def _tail_mean(t: float) -> float:
    """The mean of what a standard normal variable exceeds t by."""
    bell = math.exp(-0.5 * t * t)
    return float(0.3989422804014327 * bell - t * _normal_integral(-t, bell))


@njit(nogil=True)
def _normal_integral(t: float, bell: float) -> float:
    """The standard normal distribution's integral up to t, to 1e-7; bell : exp(-t^2 / 2), which is needed besides.

    Hastings' approximation (Abramowitz & Stegun 7.1.26): of a contrast of 255 grey levels a part in 30,000 of one.
    """
    k = 1.0 / (1.0 + 0.3275911 * 0.7071067811865476 * abs(t))
    series = 0.254829592 + k * (-0.284496736 + k * (1.421413741 + k * (-1.453152027 + k * 1.061405429)))
    tail = 0.5 * k * series * bell
    return 1.0 - tail if t > 0.0 else tail


@njit(nogil=True)
def _solve(low: FloatArray, n: int, x: FloatArray) -> None:
    """Solve L L^T x = right in place."""
    for i in range(n):
        for k in range(i):
            x[i] -= low[i, k] * x[k]
        x[i] /= low[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= low[k, i] * x[k]
        x[i] /= low[i, i]
