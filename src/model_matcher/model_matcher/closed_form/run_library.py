"""A closed-form case through the libraries: the same computation as the graph's nodes, without the graph.

Sweeps use it: it needs no ROS, starts at once and runs in as many processes as there are cores.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from csg_renderer import ideal_data, load_scene, render, render_stereo, scene_path
from csg_renderer.raycast.render import scene_rig
from msgs_py.numeric.typed import AnyArray, ByteArray
from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up as warm_up_recovery

from ..params import MatchParams
from ..pipeline import match, warm_up
from .camera_options import camera_pictures
from .case import Case
from .comparison import compare_edges, surface_residual
from .result import CaseResult, judge
from .scene_files import prepare


@cache
def be_ready() -> None:
    """Compile, or load what was compiled, once a process: that takes longer than a case and is none of its times."""
    scene = load_scene(scene_path('l_shape_v1'))
    render_stereo(scene, scene_rig(scene, 32, 32))
    warm_up_recovery()
    warm_up()


def run_library_case(case: Case, folder: Path, progress: Callable[[str], None] = lambda stage: None) -> CaseResult:
    """Render a case, recover features, match them, and compare each stage with the truth.

    Parameters
    ----------
    case : Case
        What to test.
    folder : Path
        Where the case's own scene file is written, when it needs one.
    progress : callable
        Called with the name of each stage (:data:`~model_matcher.closed_form.case.STAGES`) that is over.

    Returns
    -------
    CaseResult
        Also when nothing was recognised.

    Raises
    ------
    ValueError, OSError
        For a scene that cannot be used.
    """
    be_ready()
    _, rig, scene, name, model, true_pose = prepare(case, folder)
    progress('scene')
    clock = [time.perf_counter()]

    def lap() -> float:
        clock.append(time.perf_counter())
        return round(1e3 * (clock[-1] - clock[-2]), 2)

    milliseconds = {}
    left, right = camera_pictures(case, scene, rig)
    milliseconds['render'] = lap()
    progress('image')
    recovery = recover(left, right, rig)
    milliseconds['recover'] = lap()
    progress('features')
    params = MatchParams(time_limit_s=case.time_limit_s)
    matched = match(model, recovery.features, params, name)
    milliseconds['match'] = lap()
    progress('pose')
    ideal = ideal_data(scene, rig)
    truth = ideal.features.select(ideal.object_index == 0)
    result = CaseResult(
        case,
        name,
        rig,
        true_pose,
        model,
        truth,
        recovery.features,
        _bytes(left),
        _bytes(right),
        edges=compare_edges(truth, recovery.features),
        surface_residual_m=surface_residual(scene, render(scene, rig.left)),
        image_difference=0,
        milliseconds=milliseconds,
    )
    judge(result, matched.interpretations, matched.reason or recovery.reason)
    progress('comparison')
    return result


def _bytes(picture: AnyArray) -> ByteArray:
    """Grey levels as the report shows them."""
    return np.asarray(np.rint(picture).clip(0, 255), np.uint8)
