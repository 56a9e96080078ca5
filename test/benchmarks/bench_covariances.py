"""Whether poses are as uncertain as they say: rendered pairs of each of the thesis' models, turned at random.

Of every pair in which a model is found, the error of its pose is squared in units of its stated covariance, by features
alone and measured in the images. Where covariances are true these squares have a chi-squared distribution of six
degrees of freedom: a mean of 6, 95 of 100 below 12.6, and Kolmogorov and Smirnov's test does not tell the two apart.
A pose that is wrong (farther off than a tenth of the model's size) is counted apart, and so is one that comes with
others that explain the images as well, of which one is right (ambiguous). Symmetric poses are equal.
A pixel of a camera is a mean over its area of light that a lens has blurred: here over 6 x 6 samples of each pixel of a
picture four times finer.

    python test/benchmarks/bench_covariances.py --pairs 500
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from functools import cache

import numpy as np
from batches import add_batch_options, one_process, run_batch
from rendered_views import load_object, rendered_view
from results import add_record_option, keep
from scipy import stats

from csg_renderer import Solid, SolidOutline
from model_matcher import index_model, match
from model_matcher.geometry.pose_rows import step_between
from model_matcher.image_pose.views import Views
from model_matcher.model.index import ModelIndex
from model_matcher.model.symmetry import symmetries
from model_matcher.pipeline import warm_up
from msgs_py import FeatureSet, Pose
from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up as warm_up_recovery

MODELS = ('chipped_block', 'l_shape', 'wedge', 'chair', 'computer', 'plug')
PAIRS = 100
SAMPLES = 6
# Pairs that nothing was looked at in before.
FIRST_SEED = 70_000
UNKNOWNS = 6
# Of the model's size: an answer so far off is another pose, not an error of this one.
WRONG = 0.1
# What becomes of a pair without an error to square.
REFUSED, WRONG_POSE, AMBIGUOUS = 'refused', 'wrong', 'ambiguous'


@dataclass
class Squares:
    """Squared errors of one model's poses, in units of the stated covariance, and what else became of the pairs."""

    name: str
    squared: list[float]
    wrong: int = 0
    refused: int = 0
    ambiguous: int = 0

    def row(self) -> dict[str, float]:
        """Figures of it."""
        squared = np.array(self.squared)
        chi = stats.chi2(UNKNOWNS)
        some = len(squared) > 0
        return {
            'poses': float(len(squared)),
            'wrong': float(self.wrong),
            'refused': float(self.refused),
            'ambiguous': float(self.ambiguous),
            'mean': float(squared.mean()) if some else np.nan,
            'median': float(np.median(squared)) if some else np.nan,
            'inside': float((squared < chi.ppf(0.95)).mean()) if some else np.nan,
            'ks_p': float(stats.kstest(squared, chi.cdf).pvalue) if some else np.nan,
        }


def measured(
    name: str,
    pairs: int,
    first_seed: int = FIRST_SEED,
    options: argparse.Namespace | None = None,
    samples: int = SAMPLES,
) -> tuple[Squares, Squares]:
    """By features alone, and in the images; options: of :func:`batches.add_batch_options`."""
    jobs = {str(seed): (name, seed, samples) for seed in range(first_seed, first_seed + pairs)}
    out = Squares(name, []), Squares(name, [])
    for both in run_batch(_of_pair, jobs, options or one_process(), name, _ready).values():
        for squares, found in zip(out, both):
            if found == REFUSED:
                squares.refused += 1
            elif found == WRONG_POSE:
                squares.wrong += 1
            elif found == AMBIGUOUS:
                squares.ambiguous += 1
            else:
                squares.squared.append(found)
    return out


def _of_pair(job: tuple[str, int, int]) -> list[float | str]:
    """The squared error of a pair's pose by features alone and in the images, REFUSED or WRONG_POSE."""
    name, seed, samples = job
    solid, model, index = _object(name)
    alike = [Pose.identity(), *symmetries(index)]
    view = rendered_view(solid, model, seed, samples)
    features = recover(view.left, view.right, view.rig).features
    out: list[float | str] = []
    for views in (None, Views.of((view.left, view.right), view.rig)):
        best = match(index, features, name=name, views=views).best
        if best is None:
            out.append(REFUSED)
            continue
        errors = [_error(pose, view.pose, alike) for pose in (best.pose, *best.ambiguous_poses)]
        right = [
            bool(np.linalg.norm(error[:3]) <= WRONG * index.size and np.linalg.norm(error[3:]) <= WRONG)
            for error in errors
        ]
        squared = float(errors[0] @ np.linalg.solve(best.covariance, errors[0]))
        out.append(squared if right[0] else AMBIGUOUS if any(right) else WRONG_POSE)
    return out


@cache
def _object(name: str) -> tuple[Solid, FeatureSet, ModelIndex]:
    solid, model = load_object(name)
    return solid, model, index_model(model, name, SolidOutline(solid))


def _ready() -> None:
    warm_up_recovery()
    warm_up(images=True)


def _error(found: Pose, true: Pose, alike: list[Pose]) -> np.ndarray:
    """Shift and turn (6,) from the true pose, the nearest of those that look the same, metres and radians."""
    nearest = min((true.compose(one) for one in alike), key=lambda pose: pose.error_to(found).rotation)
    return step_between(nearest, found)


def main(arguments: list[str] | None = None) -> int:
    """Render, recover, match, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--pairs', type=int, default=PAIRS, help='of each model')
    parser.add_argument('--samples', type=int, default=SAMPLES, help='of a pixel, along rows and along columns')
    parser.add_argument('--models', nargs='+', default=list(MODELS))
    add_batch_options(parser)
    add_record_option(parser)
    options = parser.parse_args(arguments)
    figures = {}
    head = f'{"":<26}{"poses":>7}{"wrong":>7}{"refused":>9}{"ambiguous":>11}'
    print(head + f'{"mean":>8}{"median":>8}{"inside":>8}{"KS p":>9}')
    print(f'{"where covariances are true":<60}{6.0:8.2f}{stats.chi2(UNKNOWNS).median():8.2f}{0.95:8.2f}')
    for name in options.models:
        for squares, way in zip(
            measured(name, options.pairs, options=options, samples=options.samples), ('features', 'images')
        ):
            row = figures[f'{name}, {way}'] = squares.row()
            print(
                f'{name + ", " + way:<26}{row["poses"]:7.0f}{row["wrong"]:7.0f}{row["refused"]:9.0f}'
                f'{row["ambiguous"]:11.0f}{row["mean"]:8.2f}{row["median"]:8.2f}{row["inside"]:8.2f}{row["ks_p"]:9.2g}',
                flush=True,
            )
    if options.record:
        keep(options.record, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
