"""How surely an interpretation is no accident, in nats.

Clutter explains model edges by chance, but it does so badly: its end points lie anywhere inside the tolerance, and its
pieces have any length that fits. What belongs to the model lies close to it in comparison with the tolerance, and
most of its pieces are as long as their model edge. The evidence is the logarithm of the ratio of the two probabilities,
plus a constant for each distinct model feature explained:

    features   PER_FEATURE for every distinct model feature
    position   residuals normal with the deviation they show, against deviation tolerance / 2, over their degrees of
               freedom (two for an end point, three for a curve's centre, six less for the pose)
    coverage   a model edge covered to COVERED of its length has chance WHOLE in the model, and in the data the share of
               pieces of that length among those that would fit the edge at all
"""

from __future__ import annotations

import numpy as np
from numba import njit

PER_FEATURE = 2.0
PER_CURVE = 4.0  # its centre, normal and both radii agree
COVERED = 0.75
WHOLE = 0.7
SMALLEST_DEVIATION = 0.03  # of the tolerance; ideal data is no infinite proof


@njit(cache=True)
def evidence(motion, model, data, kind_d, tols, assignment):
    """Evidence of one pose and assignment (n,), nats; rows and tolerances as in kernels.py."""
    e, n = model.shape[0], data.shape[0]
    low = np.full(e, np.inf)
    high = np.full(e, -np.inf)
    squares = 0.0
    freedom = -6.0
    total = 0.0
    for k in range(n):
        j = assignment[k]
        if j < 0:
            continue
        m, d = model[j], data[k]
        x, y, z = d[0] - motion[9], d[1] - motion[10], d[2] - motion[11]
        px = motion[0] * x + motion[3] * y + motion[6] * z - m[0]
        py = motion[1] * x + motion[4] * y + motion[7] * z - m[1]
        pz = motion[2] * x + motion[5] * y + motion[8] * z - m[2]
        vx = motion[0] * d[3] + motion[3] * d[4] + motion[6] * d[5]
        vy = motion[1] * d[3] + motion[4] * d[4] + motion[7] * d[5]
        vz = motion[2] * d[3] + motion[5] * d[4] + motion[8] * d[5]
        if kind_d[k] == 1:
            squares += (px * px + py * py + pz * pz) / tols[k, 0] ** 2
            freedom += 3.0
            if high[j] < low[j]:
                total += PER_CURVE
                low[j] = high[j] = 0.0
            continue
        if high[j] < low[j]:
            total += PER_FEATURE
        for end in range(2):
            step = d[6] if end == 0 else -d[6]
            qx, qy, qz = px + step * vx, py + step * vy, pz + step * vz
            along = qx * m[3] + qy * m[4] + qz * m[5]
            squares += max(qx * qx + qy * qy + qz * qz - along * along, 0.0) / tols[k, 0] ** 2
            low[j], high[j] = min(low[j], along), max(high[j], along)
        freedom += 4.0
    freedom = max(freedom, 1.0)
    ratio = min(max(squares / freedom, SMALLEST_DEVIATION ** 2), 0.25)
    total += 0.5 * freedom * (np.log(0.25 / ratio) - 1.0 + 4.0 * ratio)
    for j in range(e):
        if high[j] <= low[j]:
            continue
        length = 2.0 * model[j, 6]
        fitting = whole = 0
        for k in range(n):
            if kind_d[k] != 1 and 2.0 * data[k, 6] <= 1.05 * length:
                fitting += 1
                if 2.0 * data[k, 6] >= COVERED * length:
                    whole += 1
        chance = (whole + 1.0) / (fitting + 4.0)
        if high[j] - low[j] >= COVERED * length:
            total += np.log(WHOLE / chance)
        else:
            total += np.log((1.0 - WHOLE) / (1.0 - chance))
    return total
