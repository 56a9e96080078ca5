"""Whether the four searches give one best interpretation of every view, ideal and recovered from its rendered "
"pair."""

from __future__ import annotations

from typing import Any

import numpy as np
from lab import Experiment, NotAvailable, Outcome, Setting, Table, recovered, timed, view
from thesis import VIEWS

from csg_renderer import ideal_data, scene_names
from model_matcher import MatchParams, match
from msgs_py import Interpretation, Pose

SEARCHES = ('hypotheses', 'tree', 'subgraph', 'serial')
LIMIT_S = 20.0
SAME_DEG, SAME_SIZE = 0.01, 1e-4  # poses of one interpretation, refined from different starts
RIGHT_DEG, RIGHT_MM = 1.0, 3.0


def agreement(setting: Setting) -> Outcome:
    names = [n for n in setting.pick(list(VIEWS), ['wedge_v2']) if n in scene_names()]
    if not names:
        raise NotAvailable("csg_renderer has none of the thesis' views")
    table = Table(
        'The best interpretation by four searches',
        [
            'view',
            'data',
            'features',
            'matched ours',
            'rotation deg ours',
            'translation mm ours',
            'differs from hypotheses ours',
            *(f'{search} ms ours' for search in SEARCHES),
        ],
    )
    for name in names:
        this = view(name)
        for kind in ('ideal', 'recovered'):
            setting.advance(f'{name} {kind}')
            data = ideal_data(this.scene, this.rig).features if kind == 'ideal' else recovered(name)
            bests: dict[str, Interpretation | None] = {}
            spent = []
            for search in SEARCHES:
                params = MatchParams(search=search, time_limit_s=LIMIT_S)
                result, seconds = timed(lambda d=data, t=this, p=params: match(t.features, d, p), 1)
                bests[search] = result.best
                spent.append(1e3 * seconds)
            first = bests['hypotheses']
            differing = [search for search in SEARCHES[1:] if not one_interpretation(bests[search], first)]
            row: list[Any] = [name, kind, len(data), None, None, None, ', '.join(differing) or 'none', *spent]
            if first is not None:
                pose = nearest(first, this.pose)
                error = pose.error_to(this.pose)
                row[3:6] = first.matched, error.rotation_deg, 1e3 * error.translation
            table.rows.append(row)
    return Outcome(
        say,
        [table],
        notes=[
            'One interpretation: the same pairing and, but for a symmetry, the same pose. Recovered data holds '
            'broken edges and some that belong to nothing; the trees put those into the bin.'
        ],
    )


def say(tables: list[Table]) -> str:
    (table,) = tables
    errors = list(zip(table.column('rotation deg ours'), table.column('translation mm ours')))
    right = sum(turn is not None and turn <= RIGHT_DEG and shift <= RIGHT_MM for turn, shift in errors)
    differing = table.column('differs from hypotheses ours')
    same = sum(other == 'none' and turn is not None for other, (turn, _) in zip(differing, errors))
    return (
        f'The four searches give one best interpretation in {same} of {len(errors)} cases (ideal and recovered data '
        f'of {len(set(table.column("view")))} views); the pose is right within {RIGHT_DEG:g} degree and {RIGHT_MM:g} '
        f'mm in {right} of them.'
    )


def one_interpretation(one: Interpretation | None, other: Interpretation | None) -> bool:
    """The same pairs; or, where a symmetry or ambiguity is listed, one of the other's poses with as many pairs."""
    if one is None or other is None:
        return one is other
    if (one.assignment == other.assignment).all():
        return True
    near = nearest(other, one.pose)
    error = near.error_to(one.pose)
    return (
        one.matched == other.matched
        and error.rotation_deg < SAME_DEG
        and error.translation < SAME_SIZE * float(np.linalg.norm(one.pose.translation))
    )


def nearest(one: Interpretation, truth: Pose) -> Pose:
    return min((one.pose, *one.symmetric_poses), key=lambda pose: pose.error_to(truth).rotation_deg)


EXPERIMENTS = [Experiment('agreement', 'Four searches, one interpretation', '5.7, 5.8, 5.10', agreement)]
