"""Recovery with the labelling of matching/labelling.py in place of the relaxation, for a comparison side by side:

python test/benchmarks/bench_photoreal.py --recover by_labelling:recover
python test/benchmarks/bench_lines.py --kinds any flat aliased --seeds 100..119 --labelling
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any
from unittest import mock

from stereo_recovery import Recovery, pipeline
from stereo_recovery import recover as todays_recover
from stereo_recovery.matching import labelling
from stereo_recovery.matching.matches import Matches


def _matched(greys: Any, segments: Any, rig: Any, params: Any) -> Matches:
    window = pipeline._disparity_range(rig, params)
    return labelling.match(greys, segments, window, params.support_radius, params.min_belief)


@contextmanager
def in_place() -> Any:
    """Within it every recovery is by labelling."""
    with mock.patch.object(pipeline, '_matched', _matched):
        yield


def recover(left: Any, right: Any, rig: Any, params: Any = None) -> Recovery:
    """As stereo_recovery.recover."""
    with in_place():
        return todays_recover(left, right, rig, params)
