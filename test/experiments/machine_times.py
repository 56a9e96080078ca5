"""What the emulated DAP 510 takes, in both word lengths: to render a view, to match data, phase by phase."""

from __future__ import annotations

from typing import Any

import numpy as np
from lab import View

from csg_renderer.raycast import engine_dap
from csg_renderer.raycast.frame import RenderOptions
from model_matcher import MatchParams, ModelIndex, match
from msgs_py import FeatureSet, Pose

# Bytes of a REAL: Fortran-Plus' plain one, and the one that gives the native engines' numbers.
BYTES = (4, 8)
WORD_LENGTH = 'Times of the emulated machine are given for both word lengths; REAL*4 is the likelier (Table 5.2, why).'
WHY_REAL_4 = (
    'The thesis does not say which word length it used. REAL*4 is the likelier: it is what REAL means in Fortran-Plus, '
    'the listings of its appendices declare no other, the rates that it quotes of the machine are of 32 bits, and the '
    'shares that it prints of the validation are nearer to those of REAL*4 (experiment validation). Where the rest of '
    'the time may have gone: experiment tile_budget.'
)
# What the printed matching times do not hold: the data's is made off-line (5.11.3.2), the model's is not spoken of.
OFF_LINE = ('model_ranges', 'data_ranges')
TREE = ('traversal', 'signs')
VALIDATION = ('validation_set_up', 'rotation', 'jacobi', 'translation_and_scale', 'test')


def rendered_pair(this: View, length: int) -> float:
    """Seconds of a stereo pair with tiling on the emulated machine."""
    seconds = 0.0
    for camera, offset in ((this.rig.left, 0.0), (this.rig.right, this.rig.baseline)):
        pose = this.scene.camera_T_scene
        eye = Pose(pose.rotation, pose.translation - np.array([offset, 0.0, 0.0]), pose.scale)
        frame = engine_dap.render(this.scene, camera, eye, RenderOptions(), length=length)
        seconds += frame.stats.dap_cycles * 100e-9
    return seconds


class Matched:
    """One match on the emulated machine: its statistics, and seconds of its phases.

    found : interpretations that are feasible; best : the accepted one, or None
    """

    def __init__(self, index: ModelIndex, data: FeatureSet, params: MatchParams, length: int) -> None:
        result = match(index, data, params.replace(engine='dap', real_bytes=length))
        self.best, self.stats = result.best, result.stats
        self.phases: dict[str, float] = result.stats.get('dap_phases', {})
        self.found = result.stats['feasible']
        self.complete = result.stats['complete']

    def seconds(self, *phases: str) -> float:
        return sum(self.phases.get(phase, 0.0) for phase in phases)

    @property
    def matching(self) -> float:
        """What the thesis calls the total matching time: set-up, tables, sort, traversal; and elimination, if any."""
        return self.seconds('set_up', 'tables', 'sort', 'elimination', *TREE)

    @property
    def shares(self) -> list[float]:
        """Per cent of the matching time: set-up, tables, sort, traversal with signs, signs."""
        groups: list[tuple[str, ...]] = [('set_up',), ('tables',), ('sort', 'elimination'), TREE, ('signs',)]
        return [100.0 * self.seconds(*group) / self.matching for group in groups]


def both_lengths(index: ModelIndex, data: FeatureSet, **changes: Any) -> list[Matched]:
    """The match of these parameters in each of BYTES."""
    params = MatchParams(**changes)
    return [Matched(index, data, params, length) for length in BYTES]
