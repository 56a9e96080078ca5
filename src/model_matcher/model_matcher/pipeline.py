"""The facade: match one model, recognise several."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from csg_renderer import Solid, SolidOutline, model_features
from csg_renderer.features.mesh_outline import compile_steps as mesh_steps
from msgs_py import BIN, FeatureKind, FeatureSet, Interpretation, PinholeCamera, Pose
from msgs_py.numeric.deadline import Deadline, blocks
from msgs_py.numeric.steps import CompileStep, run_all
from msgs_py.numeric.threads import spread, spread_until
from msgs_py.numeric.typed import FloatArray, Int32Array

from .catalogue.build import indexed_model, write_catalogue
from .catalogue.candidates import candidates
from .catalogue.catalogue import Catalogue, open_catalogue
from .catalogue.settings import FILE_NAME
from .geometry.features import PairTable
from .geometry.line_pairs import rank_pairs
from .geometry.pose_rows import as_motion
from .geometry.settings import PARALLEL_SINE
from .image_pose.measurement import Presence, measure_pose
from .image_pose.surface import Agreement, log_ratio
from .image_pose.views import Views
from .interpretation_tree.match import match_by_tree
from .model.index import ModelIndex, extent_points, index_model, indexed
from .model.problem import Problem, make_problem, usable
from .model.regularity import regularity
from .model.settings import SEARCH_WIDTH
from .model.symmetry import Axis, distinct_pairs, symmetries
from .params import MatchParams, MatchResult, no_match
from .proof.certificate import certify
from .search.free_scale import match_free
from .search.pair_search import Candidates, kept, merge, search_pairs
from .search.parallel_search import search_all_parallel
from .search.prefilter import prefilter
from .search.settings import ALL_PAIRED, MOST_CANDIDATES, NEAR, SHARES
from .settings import LOOKED_AT, PATIENCE, PERIODIC, SIDE_BY_SIDE, Patience
from .verification.acceptance import accept
from .verification.evidence import displaced
from .verification.false_alarms import needed_evidence, needed_with_images
from .verification.image_evidence import accepted_by_images, compete
from .verification.refinement import Refined, refine_all
from .verification.settings import CANDIDATES
from .verification.turning import likeliest_turns

# What has been compiled: for features, images, an index.
_warm: set[str] = set()


def match(
    model: FeatureSet | ModelIndex,
    data: FeatureSet,
    params: MatchParams | None = None,
    name: str = 'model',
    views: Views | None = None,
    deadline: Deadline | None = None,
) -> MatchResult:
    """Find one model in recovered features.

    Parameters
    ----------
    model : FeatureSet or ModelIndex
        Model frame, metres.
    data : FeatureSet
        Camera frame, metres.
    params : MatchParams, optional
        How to match.
    name : str
        Of the model, written to the interpretations.
    views : Views, optional
        The images that the features were recovered from; the first camera's frame is that of the data. A model of which
        more than features is known is then accepted by what they show, and its pose measured in them.
    deadline : Deadline, optional
        Ends the search before its time limit; the best so far is taken then.

    Returns
    -------
    MatchResult
        Interpretations best first, or the reason why there is none. An empty model or empty data is such a reason.

    Raises
    ------
    TypeError
        For arguments of another type.
    ValueError
        For parameters that cannot be used.
    """
    params = params or MatchParams()
    _compile_first(views)
    if not isinstance(data, FeatureSet):
        raise TypeError(f'data: expected a FeatureSet, got {type(data).__name__}')
    try:
        index = indexed(model, name)
    except ValueError as error:
        return no_match(data, str(error))
    return _match(index, data, params, views, within=deadline)


def _match(
    index: ModelIndex,
    data: FeatureSet,
    params: MatchParams,
    views: Views | None = None,
    claimed: Sequence[Presence] = (),
    within: Deadline | None = None,
) -> MatchResult:
    """As :func:`match`; claimed : outlines of what has been found already, whose edges are no others'."""
    deadline = Deadline(params.time_limit_s, within)
    if params.scale == 'free':
        # One length beyond all distance would be all that the scale is read off.
        keep = usable(data, unit=None)
        result = match_free(index, data.select(keep), params, deadline, partial(_match, within=deadline))
        if len(keep) < len(data):
            found, rejected = (
                tuple(_spread(one, keep, len(data)) for one in ones)
                for ones in (result.interpretations, result.rejected)
            )
            result = replace(result, interpretations=found, rejected=rejected)
        result.stats['seconds'] = deadline.seconds
        return result
    problem = make_problem(index, data, params)
    if len(problem.rows) == 0:
        return no_match(
            data,
            'the data holds no features'
            if len(data) == 0
            else 'every data feature has length zero or lies beyond all distance',
        )
    if params.search == 'hypotheses' and not _leaves_a_shift(problem):
        result = _match_hypotheses(problem, params, deadline, views, claimed)
    else:
        result = match_by_tree(problem, params, deadline)
    if params.prove:
        result = certify(problem, result, params, deadline)
    result.stats['seconds'] = deadline.seconds
    return result


def _leaves_a_shift(problem: Problem) -> bool:
    """Whether all data is parallel, and lines only; a tree then finds what there is, with the shift along them free."""
    rows = problem.rows
    least = float(np.abs(rows[:, 3:6] @ rows[0, 3:6]).min())
    return 1.0 - least * least < PARALLEL_SINE**2 / 4.0 and not (problem.data.kind == FeatureKind.CURVE).any()


def _match_hypotheses(
    problem: Problem, params: MatchParams, deadline: Deadline, views: Views | None, claimed: Sequence[Presence]
) -> MatchResult:
    """The production search and what follows it."""
    index, rows = problem.index, problem.rows
    n = len(rows)
    neighbours, all_ranked = np.zeros((0, 0), np.int32), True
    if n > ALL_PAIRED:
        longest = 1.1 * float(index.rows[:, 6].max()) + float(problem.tolerances[:, 0].max())
        neighbours, all_ranked = _neighbours(rows, longest, deadline.share(SHARES.ranking))
    pairs, partners = rank_pairs(rows, neighbours, index.size, 2 * NEAR)
    searching = deadline.share(SHARES.searching)
    parts: list[tuple[Refined, _Found]] = []
    for least in (PATIENCE.least, math.inf):
        begin = parts[-1][1].done if parts else (0,) * SIDE_BY_SIDE
        # Parallel edges among themselves are many: they are asked when nothing else has brought an answer.
        seen = views is not None and index.shape is not None
        more = partial(_search_parallel, problem, bool(parts), searching, seen)
        found = _search(problem, (pairs, partners), begin, Patience(least, PATIENCE.most), searching, more)
        few = kept(found.scores)
        found = found._replace(motions=found.motions[:few], scores=found.scores[:few])
        refined = refine_all(problem, found.motions, found.scores, params, deadline=deadline.share(SHARES.refining))
        parts.append((refined, found))
        if (
            searching.passed
            or found.stopped_by != 'patience'
            or refined.evidence.max() >= needed_evidence(problem, params)
        ):
            break
    refined = max((part[0] for part in parts), key=lambda part: float(part.evidence.max()))
    outlines: tuple[Presence, ...] = ()
    needed = needed_evidence(problem, params)
    if views is not None and index.shape is not None:
        hypotheses = [one for part in accept(problem, refined, params, LOOKED_AT) for one in part]
        needed = needed_with_images(params)
        looked = accepted_by_images(problem, index.shape, hypotheses, views, needed, deadline, claimed)
        most = params.max_interpretations
        accepted, rejected, outlines = looked.accepted[:most], looked.rejected[:most], looked.outlines[:most]
    else:
        accepted, rejected = accept(problem, refined, params)
    stopped = found.stopped_by if all_ranked or found.stopped_by != 'exhausted' else 'time limit'
    stats = {
        'search': 'hypotheses',
        'data_features': problem.n_data,
        'pairs': sum(found.done),
        'hypotheses': sum(part[1].hypotheses for part in parts),
        'stopped_by': stopped,
        'evidence_needed': needed,
    }
    enough = np.flatnonzero(refined.scores >= min(params.min_matched, len(index)))
    if len(enough):
        stats['evidence'] = float(refined.evidence[enough].max())
    reason = None
    if not accepted:
        reason = rejected[0].rejected_reason if rejected else 'no pair of data features fits the model'
    return MatchResult(accepted, rejected, stats, reason, outlines)


class _Found(NamedTuple):
    """What a search has found.

    Attributes
    ----------
    motions, scores : (c, 12), (c,) float64
        Candidate poses, best first.
    done : tuple of int
        Pairs that each part of the search has tried, where it goes on.
    hypotheses : int
        Those of all of them.
    stopped_by : str
        Why it stopped.
    """

    motions: FloatArray
    scores: FloatArray
    done: tuple[int, ...]
    hypotheses: int
    stopped_by: str


def _search(
    problem: Problem,
    ranked: tuple[Int32Array, Int32Array],
    begin: tuple[int, ...],
    patience: Patience,
    deadline: Deadline,
    more: Callable[[], _Found],
) -> _Found:
    """Try the ranked pairs, with their partners, from where an earlier search left off, and search for more beside.

    Every second pair is tried by itself, with half of the patience, and what all have found is put together: it does
    not depend on threads. begin : see :class:`_Found`; more : another search
    """
    # Before threads begin, each of which would make it.
    table = distinct_pairs(problem.index)
    wait = Patience(patience.least / SIDE_BY_SIDE, patience.most / SIDE_BY_SIDE)
    pairs, partners = ranked
    searches: list[Callable[[], _Found]] = []
    for part in range(SIDE_BY_SIDE):
        mine = np.ascontiguousarray(pairs[part::SIDE_BY_SIDE]), partners
        searches.append(partial(_search_some, problem, table, mine, begin[part], wait, deadline))
    parts = spread(lambda search: search(), [*searches, more])
    found, *others = sorted(parts, key=lambda one: -float(one.scores[0]))
    for other in others:
        merge(Candidates(other.motions, other.scores), problem.model, Candidates(found.motions, found.scores))
    return found._replace(
        done=tuple(done for one in parts for done in one.done),
        hypotheses=sum(one.hypotheses for one in parts),
        stopped_by=max((one.stopped_by for one in parts), key=('exhausted', 'patience', 'time limit').index),
    )


def _search_parallel(problem: Problem, edges: bool, deadline: Deadline, seen: bool) -> _Found:
    """Try pairs of parallel data; see :func:`.search.parallel_search.search_all_parallel`."""
    some = _no_candidates()
    return _Found(*some, (), search_all_parallel(problem, edges, some, deadline, seen), 'exhausted')


def _search_some(
    problem: Problem,
    table: PairTable,
    ranked: tuple[Int32Array, Int32Array],
    begin: int,
    patience: Patience,
    deadline: Deadline,
) -> _Found:
    """Try ranked pairs, with their partners, from one of them on; table : of the model's pairs."""
    pairs, partners = ranked
    about = pairs, partners, problem.model, table, problem.features, SEARCH_WIDTH
    some = _no_candidates()
    state = np.array([0, 0, begin, 0])
    for first, last in blocks(len(pairs), deadline, begin):
        search_pairs(*about, first, last, patience, some, state)
        if state[3]:
            break
    in_time = state[2] >= len(pairs) or not deadline.passed
    stopped = 'patience' if state[3] else 'exhausted' if in_time else 'time limit'
    return _Found(*some, (int(state[2]),), int(state[0]), stopped)


def _no_candidates() -> Candidates:
    """Room for as many as a search keeps."""
    return Candidates(np.zeros((PERIODIC * CANDIDATES, 12)), np.zeros(PERIODIC * CANDIDATES))


def _neighbours(rows: np.ndarray, longest: float, deadline: Deadline) -> tuple[np.ndarray, bool]:
    """(n, m) int32 nearest features of each one, and whether there was time for all.

    Curves and long edges go first, edges whose half length exceeds ``longest`` (metres) last, for the model has
    none such. Where there was no time, a feature has -1 for its neighbours.
    """
    count = min(len(rows), 6 * NEAR)
    near = np.full((len(rows), count), -1, np.int32)
    order = np.lexsort((-rows[:, 6], rows[:, 6] > 0.0, rows[:, 6] > longest))
    tree = cKDTree(rows[:, :3])
    last = 0
    for first, last in blocks(len(rows), deadline):
        some = order[first:last]
        near[some] = tree.query(rows[some, :3], k=count)[1]
    return near, last == len(rows)


def recognise(
    models: Sequence[FeatureSet | ModelIndex] | Catalogue, data: FeatureSet, params: MatchParams | None = None
) -> list[Interpretation]:
    """Find several models, and several instances of each.

    Parameters
    ----------
    models : sequence of FeatureSet or ModelIndex, or Catalogue
        Feature sets are named model0, model1, ...; indexes have names of their own. A catalogue
        (:func:`.catalogue.catalogue.open_catalogue`) may hold any number of models.
    data : FeatureSet
        Camera frame, metres.
    params : MatchParams, optional
        How to match.

    Returns
    -------
    list of Interpretation
        Best first (most data explained); assignments refer to the whole of ``data``, and no data feature is in two of
        them.
    """
    return list(survey(models, data, params).interpretations)


def survey(
    models: Sequence[FeatureSet | ModelIndex] | Catalogue,
    data: FeatureSet,
    params: MatchParams | None = None,
    views: Views | None = None,
    deadline: Deadline | None = None,
) -> MatchResult:
    """As :func:`recognise`, with the rejected hypotheses and their reasons.

    What has the most evidence of all models claims the data that it explains, and with images the edges on which its
    outline lies; the search goes on in what is left, until nothing more is accepted. The time limit is one for all of
    it: each model has an even share of what those before it have left.

    Of a catalogue its candidates are searched. The false_alarm_rate is then that of all its models together, and what
    has the most evidence claims data, for among very many some model explains a little more by chance.

    Parameters
    ----------
    models, data, params, views, deadline
        As for :func:`match`.

    Returns
    -------
    MatchResult
        Of all models together; stats['out_of_time'] names those for which no time was left.
    """
    params = params or MatchParams()
    if not isinstance(data, FeatureSet):
        raise TypeError(f'data: expected a FeatureSet, got {type(data).__name__}')
    _compile_first(views, len(models), isinstance(models, Catalogue))
    deadline = Deadline(params.time_limit_s, deadline)
    n_models = len(models)
    indexes: list[ModelIndex]
    reasons: list[str] = []
    by_evidence = views is not None or isinstance(models, Catalogue)
    if isinstance(models, Catalogue):
        # One absent model of so many is reported no more often than a single one would be.
        params = params.replace(false_alarm_rate=_rate_of_each(params, n_models))
        picked = candidates(models, data, params, deadline.share(SHARES.searching))
        indexes = [models.one_of_all(one) for one in picked]
        if views is not None:
            indexes = [models.outlined(one) for one in indexes]
    else:
        indexes, reasons = _usable_models(models)
        n_models = len(indexes)
        if n_models > MOST_CANDIDATES and params.scale == 'known':
            indexes = [indexes[k] for k in prefilter(indexes, data, params, deadline.share(SHARES.ranking))]
    if n_models and not indexes:
        reasons.append('no model of the library explains three data features near each other')
    accepted: list[Interpretation] = []
    rejected: list[Interpretation] = []
    outlines: list[Presence] = []
    left = np.arange(len(data))
    out_of_time: set[str] = set()

    def search(number: int, seconds: float) -> MatchResult:
        """A model in the data that is left, in so many seconds."""
        if seconds <= 0.0:
            out_of_time.add(indexes[number].name)
            return no_match(data, f'no time was left to look for {indexes[number].name}')
        limited = params.replace(time_limit_s=seconds)
        return _match(indexes[number], data.select(left), limited, views, tuple(outlines), deadline)

    results = spread_until(search, range(len(indexes)), deadline)
    while True:
        bests = [result.best for result in results]
        score = [-np.inf if best is None else _weight(best, by_evidence) for best in bests]
        winner = int(np.argmax(score)) if score else 0
        best = bests[winner] if score else None
        if best is None:
            break
        accepted.append(_spread(best, left, len(data)))
        keep = best.assignment == BIN
        new = results[winner].outlines[:1]
        outlines += new
        # Models that did not use what is claimed keep their result; it only has to be renumbered.
        again: list[int] = []
        for number, result in enumerate(results):
            other = result.best
            if other is None or not ((other.assignment[~keep] != BIN).any() or compete(result.outlines[:1], new)):
                results[number] = MatchResult(
                    tuple(_thin(one, keep) for one in result.interpretations[:1]),
                    tuple(_thin(one, keep) for one in result.rejected),
                    {},
                    result.reason,
                    result.outlines[:1],
                )
            else:
                again.append(number)
        left = left[keep]
        for number, result in zip(again, spread_until(search, again, deadline)):
            results[number] = result
    for result in results:
        rejected += [_spread(one, left, len(data)) for one in result.rejected]
        reasons += [result.reason] if result.reason else []
    rejected.sort(key=lambda one: -one.matched)
    stats = {
        'data_features': len(data),
        'models': n_models,
        'searched': len(indexes),
        'seconds': deadline.seconds,
        'out_of_time': sorted(out_of_time),
    }
    reason = None if accepted else '; '.join(dict.fromkeys(reasons)) or 'there are no models'
    if isinstance(models, Catalogue):
        accepted, rejected = ([_of_all(one, n_models) for one in ones] for ones in (accepted, rejected))
    return MatchResult(tuple(accepted), tuple(rejected), stats, reason, tuple(outlines))


def _usable_models(models: Sequence[FeatureSet | ModelIndex]) -> tuple[list[ModelIndex], list[str]]:
    """Models ready for matching, and why others are not."""
    indexes, reasons = [], []
    for number, model in enumerate(models):
        try:
            indexes.append(indexed(model, f'model{number}'))
        except ValueError as error:
            reasons.append(str(error))
    return indexes, reasons


def _rate_of_each(params: MatchParams, models: int) -> float:
    """The rate of false alarms of each of so many models that have the one asked for together."""
    return params.false_alarm_rate if params.false_alarm_rate >= 1.0 else params.false_alarm_rate / max(models, 1)


def _of_all(one: Interpretation, models: int) -> Interpretation:
    """An interpretation whose chance is that of any of so many models."""
    return replace(one, chance=min(1.0, models * one.chance))


def _weight(one: Interpretation, by_evidence: bool) -> float:
    """By what interpretations of several models are compared: data explained; with images or many models, evidence."""
    return one.evidence if by_evidence else one.matched


def _spread(one: Interpretation, left: np.ndarray, n: int) -> Interpretation:
    """An interpretation of the features ``left`` as one of all n."""
    assignment = np.full(n, BIN, np.int32)
    sign = np.zeros(n, np.int8)
    assignment[left], sign[left] = one.assignment, one.sign
    return replace(one, assignment=assignment, sign=sign)


def _thin(one: Interpretation, keep: np.ndarray) -> Interpretation:
    """An interpretation without the features that are gone."""
    assignment = one.assignment[keep]
    return replace(one, assignment=assignment, sign=one.sign[keep], matched=int((assignment != BIN).sum()))


def compile_steps(
    params: MatchParams | None = None, n_models: int = 1, images: bool = False, catalogue: bool = False
) -> tuple[CompileStep, ...]:
    """What :func:`match` needs compiled, as small computations that use it all.

    Parameters
    ----------
    params : MatchParams, optional
        Search, scale and proof that will be asked for.
    n_models : int
        Models that will be searched together: a large library has a search of its own.
    images : bool
        Whether there will be images to look at.
    catalogue : bool
        Whether the models are those of an index.
    """
    corners = np.array([[0, 0, 0], [1, 0, 0], [0.2, 1.1, 0], [0.3, 0.2, 1.2], [1.1, 0.9, 0.8]])
    first, last = np.triu_indices(len(corners), 1)
    model = FeatureSet.concatenate(
        [
            FeatureSet.from_edges(corners[first], corners[last]),
            FeatureSet.from_curves([[0.5, 0.5, 0]], [[0, 0, 1]], [0.2]),
        ]
    )
    bars = FeatureSet.from_edges(corners[:4], corners[:4] * [1, 1, 0] + [0, 0, 2])
    rod = FeatureSet.from_curves([[0, 0, 0], [0, 0, 1]], [[0, 0, -1], [0, 0, 1]], [0.2, 0.2])
    asked = params or MatchParams()

    def with_params(wanted: MatchParams) -> None:
        _warm.add('features')
        # Whatever evidence there is suffices: nothing is to be compiled only when something is found.
        match(model, model, replace(wanted, false_alarm_rate=1.0))
        problem = make_problem(indexed(model, 'model'), model, wanted)
        symmetries(indexed(rod, 'rod'))
        none = Candidates(np.zeros((1, 12)), np.zeros(1))
        search_all_parallel(problem, True, none, Deadline())

    steps = [CompileStep('search by pairs of features', lambda: with_params(MatchParams()))]
    if asked != MatchParams():
        steps.append(CompileStep('the search that parameters ask for', lambda: with_params(asked)))
    steps.append(CompileStep('search by a tree', lambda: match(bars, bars)))  # all being parallel
    if catalogue:
        steps.append(CompileStep('candidates from an index', lambda: _ask_an_index(model, asked)))
    elif n_models > MOST_CANDIDATES:
        steps.append(CompileStep('choice from a library', lambda: prefilter([indexed(model, 'model')], model, asked)))
    if images:
        steps += [CompileStep('what images show of a model', _find_in_image), *mesh_steps()]
    return tuple(steps)


def _ask_an_index(model: FeatureSet, params: MatchParams) -> None:
    """Make an index of one model, and ask for its candidates."""
    _warm.add('index')
    with TemporaryDirectory() as folder:
        path = Path(folder) / FILE_NAME
        write_catalogue(path, [indexed_model(model, 'model')])
        candidates(open_catalogue(path), model, params)


def _find_in_image() -> None:
    """Find two blocks, each with a pin, in pictures of their outlines.

    The pin makes rims and a free turn; two of them make outlines that may compete. Two eyes look at their surfaces.
    """
    _warm.add('images')
    camera = PinholeCamera.centred(160, 120, 200.0)
    solid = Solid.block(0.06, 0.05, 0.04) | Solid.cylinder(0.02, (0.0, 0.0, 0.08))
    index = index_model(model_features(solid), 'model', SolidOutline(solid))
    poses = [Pose.from_rotation_vector([0.5, 0.4, 0.0], [x, 0.0, 0.25]) for x in (-0.06, 0.03)]
    stands = (Pose.identity(), Pose(np.eye(3), np.array([0.01, 0.0, 0.0])))
    pictures = np.random.default_rng(0).integers(60, 80, (len(stands), 120, 160), dtype=np.uint8)
    for picture, stand in zip(pictures, stands):
        for pose in poses:
            corners = camera.project(stand.inverse().apply(pose.apply(extent_points(index.features))))
            picture[Delaunay(corners).find_simplex(camera.pixel_grid()).reshape(picture.shape) >= 0] += 100
    data = FeatureSet.concatenate([index.features.transformed(pose) for pose in poses])
    views = Views(list(pictures), [camera] * 2, stands)
    survey([index], data, MatchParams(false_alarm_rate=1.0), views)
    # Noise has no patches that tell where they are, and shows more or less of a pose: what follows may not be reached.
    log_ratio((Agreement(1, 2),))
    outline = SolidOutline(solid)
    measure_pose(outline, poses[0], views)
    likeliest_turns(index, outline, Axis(np.zeros(3), np.array([0.0, 0.0, 1.0])), poses[0], views, Deadline())
    problem = make_problem(index, data, MatchParams())
    displaced(
        as_motion(poses[0]),
        problem.model,
        problem.features,
        np.full(len(data), BIN, np.int32),
        np.zeros(len(index), bool),
        regularity(index).faces,
    )


def warm_up(
    params: MatchParams | None = None, n_models: int = 1, images: bool = False, catalogue: bool = False
) -> None:
    """Compile, or load from the cache, all that :func:`match` needs, so that no first message waits for it.

    params : search, scale and proof that will be asked for; n_models : a large library has a search of its own
    images : whether there will be images to look at; catalogue : whether the models are those of an index
    """
    run_all(compile_steps(params, n_models, images, catalogue))


def _compile_first(views: Views | None, n_models: int = 1, catalogue: bool = False) -> None:
    """What a search needs is compiled before its clock starts."""
    needed = {'features', *(['images'] if views is not None else []), *(['index'] if catalogue else [])}
    if not needed <= _warm:
        warm_up(n_models=n_models, images=views is not None, catalogue=catalogue)
