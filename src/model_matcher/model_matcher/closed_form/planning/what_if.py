"""Other cameras: what another baseline, focal length, calibration or a third camera would make of every view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .rig import PlannedRig

# Of the baseline, and of the focal length: half steps of doubling to either side.
FACTORS = (0.5, 0.7, 1.4, 2.0)
# Pixels, of the cameras and of the part's edges.
OFF_PX = (0.1, 0.3)


def variants(rig: PlannedRig) -> dict[str, PlannedRig]:
    """Cameras that differ from a rig in one thing each, by what a table calls them."""
    found = {f'baseline {_mm(factor * rig.pair.baseline)}': rig.with_baseline(factor) for factor in FACTORS}
    found |= {f'focal length {factor * rig.pair.left.fx:.4g} pixels': rig.with_focal(factor) for factor in FACTORS}
    if rig.third is None:
        found['a third camera, a baseline below the middle'] = rig.with_third()
    found['half the noise'] = replace(rig, sensor=rig.sensor.with_noise(0.5))
    found |= {
        f'cameras off by {px:g} pixels after calibration': replace(rig, calibration_px=px)
        for px in OFF_PX
        if px > rig.calibration_px
    }
    found |= {
        f'edges of the part off by {px:g} pixels': replace(rig, outline_px=px) for px in OFF_PX if px > rig.outline_px
    }
    return found


def middle_errors(errors: list[list[list[float]]]) -> list[float]:
    """Of all views, [[median, worst] of position, of rotation]: the median of medians and 95 % of the worst, both.

    Examples
    --------
    >>> middle_errors([[[1.0, 2.0], [3.0, 4.0]]] * 3)
    [1.0, 2.0, 3.0, 4.0]
    """
    table = np.asarray(errors, float)
    typical, worst = np.median(table[:, :, 0], axis=0), np.quantile(table[:, :, 1], 0.95, axis=0)
    return [float(typical[0]), float(worst[0]), float(typical[1]), float(worst[1])]


def _mm(metres: float) -> str:
    return f'{1e3 * metres:.4g} mm'
