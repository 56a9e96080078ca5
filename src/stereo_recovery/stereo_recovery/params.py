"""What a user may tune."""

from __future__ import annotations

from dataclasses import dataclass

# Edge detectors that a user may choose from (thesis 3.7.1).
DETECTORS = ('canny', 'sobel', 'roberts', 'marr-hildreth')


@dataclass(frozen=True)
class RecoveryParams:
    """Parameters of :func:`.pipeline.recover`. Raises ValueError, naming the parameter, for values out of range.

    detector : 'canny', 'sobel', 'roberts' or 'marr-hildreth'; sigma : smoothing, pixels
    low, high : thresholds of hysteresis, grey levels per pixel of the smoothed image; never below 5 and 7 times the
        image noise, which is measured
    min_length : shortest straight edge, pixels
    min_disparity, max_disparity : pixels; by default from just in front of infinity to nearly the image's width
    support_radius : neighbourhood in which matches support each other, pixels
    min_belief : a match is kept when its best competitor has less than 1 - this share of its strength (roughly)
    rectification_sigma : pixels by which corresponding rows may disagree; about 0.2 for a typical calibration
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

    def __post_init__(self) -> None:
        if self.detector not in DETECTORS:
            raise ValueError(f'detector: expected one of {", ".join(DETECTORS)}, got {self.detector!r}')
        for name, low, high in (
            ('sigma', 0.5, 5.0),
            ('low', 0.1, 255.0),
            ('high', 0.1, 255.0),
            ('min_length', 3.0, 1000.0),
            ('support_radius', 1.0, 10000.0),
            ('min_belief', 0.0, 1.0),
            ('rectification_sigma', 0.0, 5.0),
            ('min_disparity', -1e5, 1e5),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f'{name}: expected {low:g} to {high:g}, got {value}')
        if self.high < self.low:
            raise ValueError(f'high: expected at least low = {self.low:g}, got {self.high:g}')
        if self.max_disparity is not None and not self.max_disparity > self.min_disparity:
            raise ValueError(
                f'max_disparity: expected more than min_disparity = {self.min_disparity:g}, got {self.max_disparity}'
            )
