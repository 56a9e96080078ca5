"""How far measured poses are off the Cramer-Rao bound in the thesis' views, and which part of that is no noise.

Each view is measured with several noises. What errors have in common (bias) is not the noise's: it is of the renderer's
samples, or of what the fit does not model; what differs is scatter. Both are root mean squares of an unknown of the
pose, in units of the bound (pose_bounds.py): 0 and 1 where a method reaches it. ``--finer n`` renders pictures n times
finer, with 8 x 8 samples in each pixel of those, and does not round them before the noise: what of the bias it takes
away was the pictures'.

    python test/benchmarks/bench_bound.py --seeds 8
    python test/benchmarks/bench_bound.py --seeds 8 --finer 8
"""

from __future__ import annotations

import argparse
import sys
from functools import partial

import numpy as np
from batches import add_batch_options, run_batch
from rendered_poses import rendered_pair, view_names

from model_matcher.geometry.pose_rows import as_motion, step_between
from model_matcher.image_pose.measurement import polished
from model_matcher.image_pose.views import Views
from model_matcher.pipeline import warm_up


def errors_over_bound(job: tuple[str, int, int]) -> list[list[float]]:
    """(seeds, 6): errors of the poses of a view, uncorrelated and in units of the bound.

    job : the view's name, seeds, and finer pixels (see :func:`.rendered_poses.rendered_pair`)
    """
    name, seeds, finer = job
    rows = []
    for seed in range(seeds):
        posed = rendered_pair(name, seed, finer)
        pose, bound = posed.instances[0].pose, posed.bounds[0]
        values, axes = np.linalg.eigh(bound.information)
        whiten = (axes * np.sqrt(np.maximum(values, 0.0))).T
        views = Views.of((posed.pair.left, posed.pair.right), posed.pair.rig)
        found = polished(posed.asked[0].index.shape, as_motion(pose), views)
        rows.append((whiten @ step_between(pose, found.pose)).tolist())
    return rows


def bias_and_scatter(errors: np.ndarray) -> tuple[float, float]:
    """Root mean squares of what errors (n, d) have in common, and of how they differ.

    Examples
    --------
    >>> bias_and_scatter(np.array([[3.0, 2.0], [3.0, 2.0], [3.0, 2.0]]))
    (2.5495097567963922, 0.0)
    """
    mean = errors.mean(axis=0)
    variance = float(((errors - mean) ** 2).sum() / (len(errors) - 1) / errors.shape[1])
    # Of the mean's square noise makes so much.
    common = float((mean**2).mean()) - variance / len(errors)
    return float(np.sqrt(max(common, 0.0))), float(np.sqrt(variance))


def main(arguments: list[str] | None = None) -> int:
    """Print a line a view, and their medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=8, help='noises of each view, two or more (default 8)')
    parser.add_argument('--finer', type=int, default=0, help='pixels rendered along each side of one (default 0)')
    add_batch_options(parser)
    options = parser.parse_args(arguments)
    if options.seeds < 2:
        parser.error(f'--seeds: expected two or more, got {options.seeds}')
    if options.finer < 0:
        parser.error(f'--finer: expected 0 or more, got {options.finer}')
    jobs = {name: (name, options.seeds, options.finer) for name in view_names()}
    found = run_batch(errors_over_bound, jobs, options, f'bound {options.finer}', partial(warm_up, images=True))
    print(f'{"times the bound":18s} {"all":>7s} {"bias":>7s} {"scatter":>7s}')
    every = []
    for name in jobs:
        errors = np.array(found[name])
        bias, scatter = bias_and_scatter(errors)
        every.append((float(np.sqrt((errors**2).mean())), bias, scatter))
        print(f'{name:18s} ' + ' '.join(f'{value:7.2f}' for value in every[-1]))
    print(f'{"median":18s} ' + ' '.join(f'{value:7.2f}' for value in np.median(every, axis=0)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
