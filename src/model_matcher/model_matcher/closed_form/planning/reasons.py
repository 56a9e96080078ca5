"""Why a view tells little of a pose: what of it is known worst, and what of the picture is the cause."""

from __future__ import annotations

import numpy as np

from ...image_pose.settings import FEWEST_POINTS, LEAST_RUN
from .part import PlannedPart
from .prediction import Prediction
from .settings import CLEARLY_WORST, FEWEST_CURVES


def visible_curves(prediction: Prediction) -> int:
    """How many creases and contours of the part the first camera sees at more points than chance would show."""
    placed = prediction.sight.placed
    counts = np.bincount(placed.group[(placed.eye == 0) & (prediction.weight > 0.0)])
    return int((counts >= LEAST_RUN).sum())


def weakness(prediction: Prediction, part: PlannedPart) -> str:
    """What is known worst of a pose, in words: depth, a shift aside, a turn about or across the line of sight."""
    radius = part.ball[1]
    units = np.array([radius] * 3 + [1.0] * 3)
    values, vectors = np.linalg.eigh(prediction.covariance * np.outer(units, units))
    worst = vectors[:, np.argmax(values)]
    ray = prediction.pose.apply(part.ball[0])
    ray = ray / np.linalg.norm(ray)
    turn, shift = worst[:3], worst[3:]
    if np.linalg.norm(turn) > np.linalg.norm(shift):
        along = abs(turn @ ray) > np.linalg.norm(turn - (turn @ ray) * ray)
        return 'the turn about the line of sight' if along else 'the tilt'
    along = abs(shift @ ray) > np.linalg.norm(shift - (shift @ ray) * ray)
    return 'the depth' if along else 'the place across the line of sight'


def reason(prediction: Prediction, part: PlannedPart) -> str:
    """Why a pose is not known better than it is; what is likeliest to be the cause comes first.

    Parameters
    ----------
    prediction : Prediction
    part : PlannedPart

    Returns
    -------
    str
        A phrase such as 'too few edges: 2 are seen'.

    Examples
    --------
    >>> from .part import load_part
    >>> from .prediction import predict
    >>> from .rig import PlannedRig, rig_of_numbers
    >>> from msgs_py import Pose
    >>> rig = PlannedRig(rig_of_numbers((320, 240), 400.0, 0.05))
    >>> part = load_part('l_shape')
    >>> reason(predict(part, Pose(translation=[2.0, 0.0, 0.3]), rig), part)
    'too far away or out of the picture: 0 places of its outline can be measured'
    """
    sight, good = prediction.sight, prediction.weight > 0.0
    if prediction.measured < FEWEST_POINTS:
        if len(sight) < FEWEST_POINTS:
            seen = prediction.measured
            return f'too far away or out of the picture: {seen} places of its outline can be measured'
        return 'too little contrast between its faces and to what is behind'
    curves = visible_curves(prediction)
    if curves < FEWEST_CURVES:
        return f'too few edges: {curves} {"is" if curves == 1 else "are"} seen'
    worst = weakness(prediction, part)
    radius = part.ball[1]
    units = np.array([radius] * 3 + [1.0] * 3)
    values = np.sort(np.linalg.eigvalsh(prediction.covariance * np.outer(units, units)))
    if ('turn' in worst or 'tilt' in worst) and values[-1] > CLEARLY_WORST**2 * values[-2]:
        return f'symmetric from here: nothing that is seen tells {worst}'
    if worst == 'the depth':
        information = prediction.weight * sight.spacing
        # The disparity of an edge is known worse than an upright one's by the cosine of its normal to the rows.
        flat = CLEARLY_WORST * np.abs(sight.placed.normal[:, 0]) < 1.0
        if information[good & flat].sum() > information[good & ~flat].sum():
            return 'along the rows: its edges run along the baseline, and tell no depth'
    if good.sum() < (~good).sum():
        return f'half of its outline is crowded or without contrast; {worst} is known worst'
    return f'{worst} is known worst'
