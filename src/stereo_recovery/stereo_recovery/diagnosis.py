"""Why a pair gives nothing: what is wrong with its images is tried out, and the remedy that helped is named.

Nothing is guessed: that the images are exchanged is said when their edges match better the other way round (a point in
front of the cameras has a positive disparity, so few do), that they are raw when they match better rectified, that they
are blurred when edges are wider than the detector's own smoothing makes them.
"""

from __future__ import annotations

import cv2
import numpy as np

from msgs_py.numeric.typed import Float32Array

from .cameras.calibration import load_cameras
from .cameras.rectification import Rectifier
from .detection.edgels import as_grey, blur_variance
from .detection.view import detect_view
from .pair_files import PairFiles
from .params import RecoveryParams
from .pipeline import Recovery, matched_length
from .settings import LEAST_SIDE


def doubts(pair: PairFiles, params: RecoveryParams | None = None) -> list[str]:
    """What is wrong with the images of a pair even if something was found, a line each.

    Raw images taken as rectified are recovered in part, and are millimetres off; where the calibration has anything to
    correct it is tried whether edges match better with it.
    """
    if not pair.lenses:
        return []
    own = matched_length(pair.left, pair.right, pair.rig, params)
    rectifier = Rectifier(*load_cameras(pair.calibration, (pair.rig.left.width, pair.rig.left.height)))
    rectified = matched_length(*rectifier.apply(pair.left, pair.right), rectifier.rig, params)
    if rectified <= own:
        return []
    return [
        f'{_names(pair)}: the images are raw: {_pixels(rectified)} of edges match when they are rectified, '
        f'{_pixels(own)} as given. Add --raw'
    ]


def remedies(pair: PairFiles, recovery: Recovery, params: RecoveryParams | None = None) -> list[str]:
    """What is wrong with the images of a pair in which nothing was found, a line each.

    Parameters
    ----------
    pair : PairFiles
    recovery : Recovery
        Of the pair.
    params : RecoveryParams, optional
        Of the recovery.

    Returns
    -------
    list of str
        Each begins with what it is about and ends with what to do; none where the images are in order.
    """
    params = params or RecoveryParams()
    found = []
    own = matched_length(pair.left, pair.right, pair.rig, params)
    exchanged = matched_length(pair.right, pair.left, pair.rig, params)
    if exchanged > own:
        found.append(
            f'{_names(pair)}: left and right are exchanged: {_pixels(exchanged)} of edges match the other way round, '
            f'{_pixels(own)} as given. Give them in the other order'
        )
    blur = camera_blur(recovery, params)
    if blur > params.sigma:
        found.append(
            f'{_names(pair)}: the images are blurred: edges are smeared by {blur:.1f} pixels (standard deviation), '
            f'more than by the smoothing of the detector ({params.sigma:g}). Focus, expose for a shorter time, or hold '
            'camera and object still'
        )
    else:
        for path, image, edgels in zip(pair.images, (pair.left, pair.right), recovery.edgels):
            found += [] if len(edgels) else [_without_edges(str(path), as_grey(image), params)]
    return found


def _names(pair: PairFiles) -> str:
    return f'{pair.images[0]}, {pair.images[1]}'


def camera_blur(recovery: Recovery, params: RecoveryParams) -> float:
    """Standard deviation of the camera's own blur, pixels; 0 where there are no edges to tell it."""
    if not all(map(len, recovery.edgels)):
        return 0.0
    # Blurs add in variance: what the detector's smoothing does not explain is the camera's.
    return float(np.sqrt(max(blur_variance(recovery.edgels) - params.sigma**2, 0.0)))


def _pixels(length: float) -> str:
    return f'{length:.0f} pixels'


def _without_edges(name: str, grey: Float32Array, params: RecoveryParams) -> str:
    """Why an image has no edges: smaller it may have some, which are not sharp; or there is no contrast."""
    smaller, factor = grey, 1
    while min(smaller.shape) > LEAST_SIDE:
        smaller, factor = np.asarray(cv2.pyrDown(smaller), np.float32), 2 * factor
        if len(detect_view(smaller, params.detector, params.sigma, params.low, params.high).segments):
            return (
                f'{name}: the image is blurred: edges are seen only when it is made {factor} times smaller. '
                'Focus, expose for a shorter time, or hold camera and object still'
            )
    return (
        f'{name}: shows no edges: its grey levels are {grey.min():.0f} to {grey.max():.0f}. '
        'Take off the cap, add light, or expose for another time'
    )
