"""Compiles what the tests need, on two cores, so that no test's time limit pays for it: ``python test/prepare.py``."""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from csg_renderer import load_scene, parse_scene, render
from model_matcher.closed_form.compile_all import main
from model_matcher.proof.warm_up import compile_kernels
from msgs_py import LensDistortion, PinholeCamera


def surfaces() -> None:
    """Pictures and metal, with and without a terrain, which no node needs unless its scene has them."""
    camera = PinholeCamera.centred(16, 16, 20.0)
    render(load_scene('printed_goods'), camera)
    render(load_scene('printed_goods'), camera, lens=LensDistortion('equidistant', (0.0, 0.0, 0.0, 0.0)))
    render(parse_scene('DRAW TERRAIN ("hills.png", 9, 9, 3) TEXTURE "carton.png" BOX (9, 9);'), camera)


if __name__ == '__main__':
    with ProcessPoolExecutor(1, get_context('spawn')) as beside:
        # Proofs, too, are compiled by the nodes whose parameters ask for them alone.
        jobs = [beside.submit(work) for work in (surfaces, compile_kernels)]
        status = main()
        for job in jobs:
            job.result()
    sys.exit(status)
