"""Data that states no covariances: how much larger its errors are along the line of sight than across it.

A camera pair sees directions well and depth badly: with a baseline of a fifth of the distance, one pixel means seven
times as much along the line of sight as across it. A fit that takes all directions alike lets depth errors turn and
shift the pose. How unequal the two are is read off the residuals, and held towards what stereo rigs are like; data
whose residuals are alike in all directions keeps the plain fit.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int8Array, Int32Array

from ..geometry.features import CURVE, DataFeatures, ModelFeatures
from ..geometry.least_squares import add_equation, damp, solve_positive
from ..geometry.rigid_motion import compose_small, transform_line
from ..model.settings import EXACT
from .settings import ALIKE, ALONG_SIGHT_SINE, FEWEST, FITS, STEREO_RATIO


@njit
def _equations(
    motion: FloatArray,
    model: ModelFeatures,
    data: DataFeatures,
    assignment: Int32Array,
    sign: Int8Array,
    centre: FloatArray,
    ratio: float,
    unit: float,
    normal: FloatArray,
    right: FloatArray,
) -> FloatArray:
    """Normal equations of point-to-line least squares about a pose, with the line of sight weighted apart.

    As least_squares.normal_equations otherwise. unit : metres, sigma across; ratio : of sigma across to sigma along
    Returns the sums of squares across and along, and their numbers.
    """
    normal[:] = 0.0
    right[:] = 0.0
    sums = np.zeros(4)
    across = 1.0 / (unit * unit)
    for k in range(data.rows.shape[0]):
        j = assignment[k]
        if j < 0:
            continue
        m, d, tolerances = model.rows[j], data.rows[k], data.tolerances[k]
        ux, uy, uz, mx, my, mz = transform_line(motion, m)
        depth = across * ratio * ratio
        # What is known worse than the rest along the line of sight counts less there.
        depth = 1.0 / (1.0 / depth + tolerances[0] * tolerances[0])
        curve = data.kind[k] == CURVE
        for end in range(1 if curve else 2):
            step = d[6] if end == 0 else -d[6]
            x, y, z = d[0] + step * d[3], d[1] + step * d[4], d[2] + step * d[5]
            far = np.sqrt(x * x + y * y + z * z)
            sx, sy, sz = x / far, y / far, z / far
            # lx: across both the line and the line of sight; ex: across the line, in the plane of both.
            lx, ly, lz = uy * sz - uz * sy, uz * sx - ux * sz, ux * sy - uy * sx
            length = np.sqrt(lx * lx + ly * ly + lz * lz)
            if length < ALONG_SIGHT_SINE:
                continue
            lx, ly, lz = lx / length, ly / length, lz / length
            ex, ey, ez = ly * uz - lz * uy, lz * ux - lx * uz, lx * uy - ly * ux
            if curve:
                qx, qy, qz = mx, my, mz
                ex, ey, ez = sx, sy, sz
            else:
                along = (x - mx) * ux + (y - my) * uy + (z - mz) * uz
                qx, qy, qz = mx + along * ux, my + along * uy, mz + along * uz
            rx, ry, rz = x - qx, y - qy, z - qz
            gx, gy, gz = qx - centre[0], qy - centre[1], qz - centre[2]
            for axis in range(3 if curve else 2):
                weight = across
                if axis == 0:
                    ax, ay, az = lx, ly, lz
                elif axis == 1:
                    ax, ay, az = ex, ey, ez
                    weight = depth
                else:
                    ax, ay, az = ly * ez - lz * ey, lz * ex - lx * ez, lx * ey - ly * ex
                residual = ax * rx + ay * ry + az * rz
                add_equation(
                    normal, right, gy * az - gz * ay, gz * ax - gx * az, gx * ay - gy * ax, ax, ay, az, residual, weight
                )
                if axis == 1:
                    sums[1] += residual * residual
                    sums[3] += 1.0
                else:
                    sums[0] += residual * residual
                    sums[2] += 1.0
            if curve:
                turn = 1.0 / (tolerances[2] * tolerances[2])
                s = 1.0 if sign[k] >= 0 else -1.0
                for axis in range(2):
                    if axis == 0:
                        ax, ay, az = lx, ly, lz
                    else:
                        ax, ay, az = ly * uz - lz * uy, lz * ux - lx * uz, lx * uy - ly * ux
                    residual = s * (ax * d[3] + ay * d[4] + az * d[5])
                    add_equation(
                        normal,
                        right,
                        uy * az - uz * ay,
                        uz * ax - ux * az,
                        ux * ay - uy * ax,
                        0.0,
                        0.0,
                        0.0,
                        residual,
                        turn,
                    )
    for i in range(6):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return sums


@njit
def sight_ratio(
    motion: FloatArray, model: ModelFeatures, data: DataFeatures, assignment: Int32Array, sign: Int8Array
) -> float:
    """How unequal the errors of the data assigned to a pose are across and along the line of sight.

    Parameters
    ----------
    motion : (12,) float64
        The pose, in the frame of a camera with its eye in the origin; overwritten by fits that read the ratio off.
    model : ModelFeatures
    data : DataFeatures
    assignment : (n,) int32
        The model feature of each data feature, negative for none.
    sign : (n,) int8
        Which way round the normals of curves are.

    Returns
    -------
    float
        The ratio of the errors across and along the line of sight; 1: alike, or not to be told.

    """
    size = model.size
    centre = np.zeros(3)
    matched = 0
    unit = np.inf
    for k in range(data.rows.shape[0]):
        if assignment[k] >= 0:
            matched += 1
            unit = min(unit, data.tolerances[k, 0])
            for i in range(3):
                centre[i] += data.rows[k, i]
    if matched < FEWEST:
        return 1.0
    centre /= matched
    # From inside the model there is no common line of sight.
    if np.sqrt(centre[0] ** 2 + centre[1] ** 2 + centre[2] ** 2) < size:
        return 1.0
    normal = np.zeros((6, 6))
    right = np.zeros(6)
    step = np.zeros(6)
    ratio = 1.0
    for turn in range(FITS + 1):
        sums = _equations(motion, model, data, assignment, sign, centre, ratio, unit, normal, right)
        if sums[3] < 1.0 or sums[1] <= (EXACT * size) ** 2 * sums[3]:
            break
        seen = np.sqrt(sums[0] / sums[2]) / np.sqrt(sums[1] / sums[3])
        if turn == FITS:
            if seen > ALIKE:
                return 1.0
            break
        ratio = np.sqrt(min(seen, 1.0) * STEREO_RATIO)
        _equations(motion, model, data, assignment, sign, centre, ratio, unit, normal, right)
        damp(normal)
        if not solve_positive(normal, right, step):
            return 1.0
        compose_small(motion, centre, step)
    return ratio
