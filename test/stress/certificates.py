"""Thousands of certificates about data at its limits: none says that fewer features are the most than a pose explains.

    python test/stress/certificates.py --cases 20000

Each case is data at 0.90 to 0.999 of every tolerance, with cones of 1 to 60 degrees and errors of 0.1 to 10 % of the
model's size (model_matcher.closed_form.synthetic.strained), half of them with next to no other pose that explains it.
It is asked whether one feature less is the most, and what match says with prove=True. What is not decided in time
counts as open.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter

import numpy as np
from tqdm import tqdm

from model_matcher import match
from model_matcher.closed_form.synthetic.scenes import MODELS
from model_matcher.closed_form.synthetic.strained import StrainedScene, strained_scene
from model_matcher.proof.certificate import prove
from msgs_py import BIN
from msgs_py.numeric.deadline import Deadline

# The lattice has so many edges that a case takes minutes.
NAMES = tuple(name for name in MODELS if name != 'lattice')


def asked(scene: StrainedScene, seconds: float) -> str:
    """What prove says of one feature less than are explained."""
    proof = prove(scene.index, scene.data, scene.explained - 1, scene.params, Deadline(seconds))
    if proof.assignment is not None and (proof.assignment != BIN).sum() >= scene.explained:
        return 'found'
    return 'false' if proof.proven else 'open'


def matched(scene: StrainedScene, seconds: float) -> str:
    """What match says: a proven size below that of the scene's pose is false, and so is a proven absence."""
    params = scene.params.replace(prove=True, time_limit_s=seconds, false_alarm_rate=1.0)
    result = match(scene.index, scene.data, params)
    if result.best is None:
        return 'false' if result.absent else 'none'
    if not result.best.proven:
        return 'open'
    return 'proven' if result.best.matched >= scene.explained else 'false'


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cases', type=int, default=20000)
    parser.add_argument('--first-seed', type=int, help='default: another one every time')
    parser.add_argument('--seconds', type=float, default=0.2, help='for one certificate')
    options = parser.parse_args(arguments)
    first = options.first_seed
    if first is None:
        first = int(np.random.SeedSequence().generate_state(1)[0])
    counts: dict[str, Counter[str]] = {'prove': Counter(), 'match': Counter()}
    false = []
    for seed in tqdm(range(first, first + options.cases), disable=not sys.stdout.isatty()):
        scene = strained_scene(seed, NAMES)
        answers = {'prove': asked(scene, options.seconds), 'match': matched(scene, options.seconds)}
        for name, answer in answers.items():
            counts[name][answer] += 1
            if answer == 'false':
                false.append((name, seed))
    print(f'{options.cases} cases from seed {first}:')
    for name, count in counts.items():
        print(f'  {name}: ' + ', '.join(f'{answer} {number}' for answer, number in sorted(count.items())))
    for name, seed in false[:20]:
        print(f'FALSE: {name}, seed {seed}')
    return 1 if false else 0


if __name__ == '__main__':
    sys.exit(main())
