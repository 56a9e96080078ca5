"""The five pairwise constraints of thesis 5.5, with exact ranges and with the thesis' own (metres, radians).

For two segments a and b, p runs along a and q along b; the ranges are those of

    distance    |q - p|
    angle       between the directions of a and b (one number)
    direction1  between q - p and the direction of a
    direction2  between q - p and the direction of b
    direction3  between q - p and the common normal a x b

A segment is a row as in features.py: mid point, unit direction, half length (0 for a CURVE: its centre). Ranges of a
data pair shrink by what its errors may have added: a true pairing, whose data lies within its stated errors, is never
pruned. Reversing a segment's direction turns an angle into its complement; that is how direction signs are found.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray

from .settings import NO_NORMAL_SINE, NOT_ZERO, RIGHT_ANGLE, ROUNDING, SMALLEST_LENGTH

DISTANCE, ANGLE, DIRECTION1, DIRECTION2, DIRECTION3 = range(5)
NAMES = ('distance', 'angle', 'direction1', 'direction2', 'direction3')
# Bits of a table entry: how the signs of a and b may relate, and which sign each may have.
SAME, DIFFERENT, A_PLUS, A_MINUS, B_PLUS, B_MINUS = (1 << bit for bit in range(6))
ANY_SIGN = SAME | DIFFERENT | A_PLUS | A_MINUS | B_PLUS | B_MINUS


@njit
def closest_points(a: FloatArray, b: FloatArray) -> tuple[float, float, float]:
    """Where two segments come closest.

    Parameters
    ----------
    a, b : (9,) float64
        Features, see features.py.

    Returns
    -------
    s, t : float
        Metres from the mid points, along the directions.
    distance : float
        Metres.

    Examples
    --------
    >>> a = np.array([0.0, 0, 0, 1, 0, 0, 0.5, 0, 0])
    >>> b = np.array([0.2, 0.3, 0.1, 0, 1, 0, 0.5, 0, 0])
    >>> [round(float(number), 12) for number in closest_points(a, b)]
    [0.2, -0.3, 0.1]

    """
    wx, wy, wz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    c = a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    wu = wx * a[3] + wy * a[4] + wz * a[5]
    wv = wx * b[3] + wy * b[4] + wz * b[5]
    ha, hb = a[6], b[6]
    best = np.inf
    best_s = best_t = 0.0
    sine2 = 1.0 - c * c
    for k in range(5):
        if k == 0:
            if sine2 < NOT_ZERO:
                continue
            s, t = (wu - c * wv) / sine2, (c * wu - wv) / sine2
            if abs(s) > ha or abs(t) > hb:
                continue
        elif k < 3:
            s = ha if k == 1 else -ha
            t = min(max(c * s - wv, -hb), hb)
        else:
            t = hb if k == 3 else -hb
            s = min(max(wu + c * t, -ha), ha)
        dx = wx + t * b[3] - s * a[3]
        dy = wy + t * b[4] - s * a[4]
        dz = wz + t * b[5] - s * a[5]
        square = dx * dx + dy * dy + dz * dz
        if square < best:
            best, best_s, best_t = square, s, t
    return best_s, best_t, np.sqrt(best)


@njit
def angle_at(a: FloatArray, b: FloatArray, s: float, t: float) -> tuple[float, float]:
    """Angle between q - p and a's direction, and |q - p|.

    Parameters
    ----------
    a, b : (9,) float64
        Features, see features.py.
    s, t : float
        Where p and q are: metres from the mid points, along the directions.

    Returns
    -------
    angle : float
        Radians.
    distance : float
        Metres.

    """
    rx = b[0] + t * b[3] - a[0] - s * a[3]
    ry = b[1] + t * b[4] - a[1] - s * a[4]
    rz = b[2] + t * b[5] - a[2] - s * a[5]
    along = rx * a[3] + ry * a[4] + rz * a[5]
    cx, cy, cz = ry * a[5] - rz * a[4], rz * a[3] - rx * a[5], rx * a[4] - ry * a[3]
    across = np.sqrt(cx * cx + cy * cy + cz * cz)
    return np.arctan2(across, along), np.sqrt(rx * rx + ry * ry + rz * rz)


@njit
def angle_to(a: FloatArray, b: FloatArray, s: float, t: float, nx: float, ny: float, nz: float) -> float:
    """Angle between q - p and a unit vector.

    atan2 keeps its digits near 0 and pi, where arccos loses half.

    Parameters
    ----------
    a, b : (9,) float64
        Features, see features.py.
    s, t : float
        Where p and q are: metres from the mid points, along the directions.
    nx, ny, nz : float
        The unit vector.

    Returns
    -------
    float
        Radians.

    """
    rx = b[0] + t * b[3] - a[0] - s * a[3]
    ry = b[1] + t * b[4] - a[1] - s * a[4]
    rz = b[2] + t * b[5] - a[2] - s * a[5]
    cx, cy, cz = ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx
    return float(np.arctan2(np.sqrt(cx * cx + cy * cy + cz * cz), rx * nx + ry * ny + rz * nz))


@njit
def stationary(a: FloatArray, b: FloatArray, s: float) -> float:
    """Where on b the angle between q - p and a's direction is stationary for a fixed p.

    With q - p split along and across a, the angle's cotangent is (A + c t) / sqrt(C + 2 D t + E t^2); its derivative
    vanishes at one t (the quadratic terms cancel).

    Parameters
    ----------
    a, b : (9,) float64
        Features, see features.py.
    s : float
        Where p is: metres from a's mid point.

    Returns
    -------
    float
        Metres from b's mid point, NaN when there is no such place.

    """
    wx, wy, wz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    c = a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    wu = wx * a[3] + wy * a[4] + wz * a[5]
    big_a = wu - s
    big_c = wx * wx + wy * wy + wz * wz - wu * wu
    big_d = wx * b[3] + wy * b[4] + wz * b[5] - c * wu
    below = c * big_d - big_a * (1.0 - c * c)
    if abs(below) < 1e-15:
        return np.nan
    return float((big_a * big_d - c * big_c) / below)


@njit
def direction_range(a: FloatArray, b: FloatArray, contact: float, error: float, cone: float) -> tuple[float, float]:
    """Range of the angle between q - p and a's direction.

    Without errors this is the exact range; a place where the segments touch has no direction and does not count.
    Otherwise the least of angle + slack and the largest of angle - slack, where slack is what the errors may do to that
    angle: bounds that a true pairing's model range cannot fail to embrace.

    Parameters
    ----------
    a, b : (9,) float64
        Features, see features.py.
    contact : float
        Metres, the distance of the segments.
    error : float
        Metres, sum of both segments' point errors.
    cone : float
        Radians, half cone angle of a's direction.

    Returns
    -------
    low, high : float
        Radians.

    """
    exact = error == 0.0 and cone == 0.0
    if exact and contact < SMALLEST_LENGTH and _cross(a, b):
        return 0.0, np.pi
    low, high = np.inf, -np.inf
    for end in range(2):
        s = a[6] if end == 0 else -a[6]
        for k in range(3):
            if k == 2:
                t = stationary(a, b, s)
                if not abs(t) <= b[6]:
                    continue
            else:
                t = b[6] if k == 0 else -b[6]
            angle, far = angle_at(a, b, s, t)
            slack = 0.0
            if exact:
                if far < SMALLEST_LENGTH:
                    continue
            elif far <= error:
                continue
            else:
                slack = np.arcsin(error / far) + cone
            low = min(low, angle + slack)
            high = max(high, angle - slack)
    if exact and high < low:
        return 0.0, np.pi
    return low, high


@njit
def _cross(a: FloatArray, b: FloatArray) -> bool:
    """Whether two segments (9,) that touch do so between the ends of both: every direction then occurs about there."""
    s, t, _ = closest_points(a, b)
    return bool(abs(s) < a[6] - SMALLEST_LENGTH and abs(t) < b[6] - SMALLEST_LENGTH)


def ranges_of_pairs(*shape: int) -> FloatArray:
    """Room for the ranges of an array of pairs, not filled: (*shape, 11) float64, see :func:`pair_ranges`."""
    return np.empty((*shape, 11))


@njit
def pair_ranges(
    a: FloatArray, b: FloatArray, error_a: float, error_b: float, cone_a: float, cone_b: float, out: FloatArray
) -> None:
    """All ranges of a pair.

    Without errors these are the exact ranges of a model pair. With errors the bounds of a data pair are drawn inwards
    by them, so that the test is always: model low <= data low and data high <= model high.

    Parameters
    ----------
    a, b : (9,) float64
        Features, see features.py.
    error_a, error_b : float
        Metres, of points.
    cone_a, cone_b : float
        Radians, half cone angles of the directions.
    out : (11,) float64
        Filled: 0, 1 distance; 2, 3 angle; 4, 5 direction1; 6, 7 direction2; 8, 9 direction3; 10: 1 when direction3 is
        defined, which it is not for parallel lines.

    """
    error = error_a + error_b
    s, t, nearest = closest_points(a, b)
    farthest = -1.0
    far_s = far_t = 0.0
    for end_a in range(2):
        for end_b in range(2):
            corner_s, corner_t = a[6] * (1 - 2 * end_a), b[6] * (1 - 2 * end_b)
            _, far = angle_at(a, b, corner_s, corner_t)
            if far > farthest:
                farthest, far_s, far_t = far, corner_s, corner_t
    out[0], out[1] = nearest + error, farthest - error
    nx = a[4] * b[5] - a[5] * b[4]
    ny = a[5] * b[3] - a[3] * b[5]
    nz = a[3] * b[4] - a[4] * b[3]
    sine = np.sqrt(nx * nx + ny * ny + nz * nz)
    cosine = a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    angle = np.arctan2(sine, cosine)
    cone = cone_a + cone_b
    out[2], out[3] = angle + cone, angle - cone
    out[4], out[5] = direction_range(a, b, nearest, error, cone_a)
    low, high = direction_range(b, a, nearest, error, cone_b)
    out[6], out[7] = np.pi - high, np.pi - low
    out[8], out[9], out[10] = 0.0, np.pi, 0.0
    exact = error == 0.0 and cone == 0.0
    if exact:
        if sine <= NO_NORMAL_SINE:
            return
        out[10] = 1.0
        if nearest < SMALLEST_LENGTH:
            # Two lines that meet lie in a plane, and so does every q - p.
            out[8] = out[9] = RIGHT_ANGLE
            return
        first = angle_to(a, b, s, t, nx / sine, ny / sine, nz / sine)
        last = angle_to(a, b, far_s, far_t, nx / sine, ny / sine, nz / sine)
        out[8], out[9] = min(first, last), max(first, last)
        return
    # The normal of two directions, each inside its cone, tilts at most by this.
    tilt = 2.0 * (np.sin(0.5 * cone_a) + np.sin(0.5 * cone_b)) / max(sine, NOT_ZERO)
    if tilt >= 1.0:
        return
    out[10] = 1.0
    low, high = np.inf, -np.inf
    for k in range(2):
        far = nearest if k == 0 else farthest
        if far <= error:
            continue
        at = angle_to(a, b, s if k == 0 else far_s, t if k == 0 else far_t, nx / sine, ny / sine, nz / sine)
        slack = np.arcsin(error / far) + np.arcsin(tilt)
        low, high = min(low, at + slack), max(high, at - slack)
    out[8], out[9] = low, high


@njit
def corner_ranges(
    a: FloatArray, b: FloatArray, error_a: float, error_b: float, cone_a: float, cone_b: float, out: FloatArray
) -> None:
    """All ranges of a pair as the thesis takes them: from the four vectors between end points.

    The extremes between the ends are left out, so that a range may be smaller than the exact one, and a fragment of an
    edge may be pruned that lies on it. Data edges are shortened by the errors of their ends; distances are drawn
    inwards by the errors, angles by the cones. Lines that are parallel as far as their cones tell have no common
    normal; direction3 lets them be such lines only.

    Parameters
    ----------
    a, b : (9,) float64
        Features, see features.py.
    error_a, error_b : float
        Metres, of the end points.
    cone_a, cone_b : float
        Radians, half cone angles of the directions.
    out : (11,) float64
        Filled as :func:`pair_ranges` does; 10: 1 when there is a common normal, -1 when there is none.

    References
    ----------
    Thesis 5.4, 5.5.
    """
    ha, hb = max(a[6] - error_a, 0.0), max(b[6] - error_b, 0.0)
    nx = a[4] * b[5] - a[5] * b[4]
    ny = a[5] * b[3] - a[3] * b[5]
    nz = a[3] * b[4] - a[4] * b[3]
    sine = np.sqrt(nx * nx + ny * ny + nz * nz)
    cosine = a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    angle = np.arctan2(sine, cosine)
    cone = cone_a + cone_b
    skew = sine > max(NO_NORMAL_SINE, np.sin(min(cone, RIGHT_ANGLE)))
    scale = 1.0 / sine if skew else 0.0
    nx, ny, nz = nx * scale, ny * scale, nz * scale
    out[0::2] = np.inf
    out[1::2] = -np.inf
    for k in range(4):
        s, t = (ha if k < 2 else -ha), (hb if k % 2 == 0 else -hb)
        rx = b[0] + t * b[3] - a[0] - s * a[3]
        ry = b[1] + t * b[4] - a[1] - s * a[4]
        rz = b[2] + t * b[5] - a[2] - s * a[5]
        far = np.sqrt(rx * rx + ry * ry + rz * rz)
        over = 1.0 / far if far > SMALLEST_LENGTH else 0.0
        values = (
            far,
            np.arccos(min(max(over * (rx * a[3] + ry * a[4] + rz * a[5]), -1.0), 1.0)),
            np.arccos(min(max(over * (rx * b[3] + ry * b[4] + rz * b[5]), -1.0), 1.0)),
            np.arccos(min(max(over * (rx * nx + ry * ny + rz * nz), -1.0), 1.0)),
        )
        for place in range(4):
            at = 2 * place + (2 if place else 0)
            out[at] = min(out[at], values[place])
            out[at + 1] = max(out[at + 1], values[place])
    out[0] += error_a + error_b
    out[1] -= error_a + error_b
    out[2], out[3] = angle + cone, angle - cone
    for at, slack in ((4, cone_a), (6, cone_b), (8, cone)):
        out[at] += slack
        out[at + 1] -= slack
    out[10] = 1.0 if skew else -1.0


@njit
def _inside(low: float, high: float, model_low: float, model_high: float) -> bool:
    """Whether a range lies in another, up to rounding."""
    return low >= model_low - ROUNDING and high <= model_high + ROUNDING


@njit
def _direction3(data: FloatArray, model: FloatArray) -> int:
    """The sign bits that direction3 leaves."""
    code = ANY_SIGN
    if data[10] < 0.0 or model[10] < 0.0:  # corner_ranges: without a normal only with such a pair
        return code if data[10] == model[10] else 0
    if data[10] > 0.0:
        # Lines whose common normal is certain are not parallel.
        if model[10] == 0.0:
            return 0
        if not _inside(data[8], data[9], model[8], model[9]):
            code &= ~SAME
        if not _inside(np.pi - data[9], np.pi - data[8], model[8], model[9]):
            code &= ~DIFFERENT
    return code


@njit
def entry(data: FloatArray, model: FloatArray, one_edge: bool, length: float, slack: float, use: BoolArray) -> int:
    """One table entry: the sign bits under which data pair and model pair agree.

    Parameters
    ----------
    data, model : (11,) float64
        As :func:`pair_ranges` gives them.
    one_edge : bool
        Whether both data features are on the same model feature.
    length : float
        Metres, of that feature.
    slack : float
        Metres, the sum of both data features' point errors.
    use : (5,) bool
        Which constraints apply.

    Returns
    -------
    int
        0 when they do not agree.

    References
    ----------
    Thesis 5.5; W. E. L. Grimson, Object Recognition by Computer, MIT Press 1990, chapter 3.

    """
    if use[0]:
        if one_edge:
            if data[1] > length + slack:
                return 0
        elif not _inside(data[0], data[1], model[0], model[1]):
            return 0
    code = ANY_SIGN
    pi = np.pi
    if use[1]:
        # The angle's slack is already in the data's bounds: low is angle + cone, high angle - cone.
        if not data[3] - ROUNDING <= model[2] <= data[2] + ROUNDING:
            code &= ~SAME
        if not pi - data[2] - ROUNDING <= model[2] <= pi - data[3] + ROUNDING:
            code &= ~DIFFERENT
    if one_edge:
        # Two pieces of one edge, clear of each other, lie on one line: q - p points along it everywhere.
        for k in range(2):
            if use[2 + k] and data[0] > 2.0 * slack and data[4 + 2 * k] < pi and data[5 + 2 * k] > 0.0:
                return 0
    else:
        for k in range(2):
            if use[2 + k]:
                low, high = data[4 + 2 * k], data[5 + 2 * k]
                if not _inside(low, high, model[4 + 2 * k], model[5 + 2 * k]):
                    code &= ~(A_PLUS if k == 0 else B_PLUS)
                if not _inside(pi - high, pi - low, model[4 + 2 * k], model[5 + 2 * k]):
                    code &= ~(A_MINUS if k == 0 else B_MINUS)
        if use[4]:
            code &= _direction3(data, model)
    if not (code & (SAME | DIFFERENT)) or not (code & (A_PLUS | A_MINUS)) or not (code & (B_PLUS | B_MINUS)):
        return 0
    return code


@njit
def consistent_signs(code: int) -> bool:
    """Whether any pair of signs satisfies all bits of an entry together.

    Parameters
    ----------
    code : int
        As :func:`entry` gives it.

    Returns
    -------
    bool

    Examples
    --------
    >>> consistent_signs(SAME | A_PLUS | B_PLUS), consistent_signs(DIFFERENT | A_PLUS | B_PLUS)
    (True, False)

    """
    for a in range(2):
        for b in range(2):
            relation = SAME if a == b else DIFFERENT
            if (code & relation) and (code & (A_PLUS << a)) and (code & (B_PLUS << b)):
                return True
    return False
