"""What a user may tune."""

from __future__ import annotations

from dataclasses import dataclass

# Edge detectors that a user may choose from (thesis 3.7.1).
DETECTORS = ('canny', 'sobel', 'roberts', 'marr-hildreth')


# Least and largest value that each parameter may have; units as in :class:`RecoveryParams`.
LIMITS = {
    'sigma': (0.5, 5.0),
    'low': (0.1, 255.0),
    'high': (0.1, 255.0),
    'min_length': (3.0, 1000.0),
    'support_radius': (1.0, 10000.0),
    'min_belief': (0.0, 1.0),
    'rectification_sigma': (0.0, 5.0),
    'min_disparity': (-1e5, 1e5),
    'time_limit': (0.001, 3600.0),
}


@dataclass(frozen=True)
class RecoveryParams:
    """Parameters of :func:`.pipeline.recover`.

    Parameters
    ----------
    detector : str
        One of DETECTORS.
    sigma : float
        Pixels. Gaussian smoothing of the images.
    low, high : float
        Grey levels per pixel. Least gradient of the smoothed image at an edgel, and the mean that three edgels of an
        edge exceed somewhere. The noise of the gradient is measured place by place, and asks for more where it is high.
    min_length : float
        Pixels. Shortest straight edge.
    min_disparity, max_disparity : float
        Pixels. Range in which matches are looked for; by default from just in front of infinity to nearly the image's
        width.
    support_radius : float
        Pixels. Neighbourhood in which matches support each other.
    min_belief : float
        Probability below which a pair of segments is no match.
    rectification_sigma : float
        Pixels. Least sigma by which single rows of the two images disagree. What the pair itself shows of that, an
        offset and a turn of the rows and what single rows differ by, is measured.
    time_limit : float, optional
        Seconds. What would begin too late is left out, and the result says what that was; the rest is the best so far.
        Detection, a first matching and a first estimate always run, and no step is broken off.

    Raises
    ------
    ValueError
        For a value out of LIMITS, for high < low and max_disparity <= min_disparity; the message names the parameter.

    Examples
    --------
    >>> RecoveryParams(min_length=20.0).min_length
    20.0
    >>> RecoveryParams(sigma=0.1)
    Traceback (most recent call last):
    ...
    ValueError: sigma: expected 0.5 to 5, got 0.1
    """

    detector: str = 'canny'
    sigma: float = 0.8
    low: float = 1.0
    high: float = 1.6
    min_length: float = 7.0
    min_disparity: float = 0.5
    max_disparity: float | None = None
    support_radius: float = 100.0
    min_belief: float = 0.5
    rectification_sigma: float = 0.01
    time_limit: float | None = None

    def __post_init__(self) -> None:
        if self.detector not in DETECTORS:
            raise ValueError(f'detector: expected one of {", ".join(DETECTORS)}, got {self.detector!r}')
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ValueError(f'{name}: expected {low:g} to {high:g}, got {value}')
        if self.high < self.low:
            raise ValueError(f'high: expected at least low = {self.low:g}, got {self.high:g}')
        if self.max_disparity is not None and not self.max_disparity > self.min_disparity:
            raise ValueError(
                f'max_disparity: expected more than min_disparity = {self.min_disparity:g}, got {self.max_disparity}'
            )
