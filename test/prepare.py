"""Compiles what the tests need, on two cores, so that no test's time limit pays for it: ``python test/prepare.py``."""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context


def compile_recovery() -> None:
    from stereo_recovery.pipeline import warm_up

    warm_up()


def compile_matcher_and_renderer() -> None:
    import csg_renderer
    from model_matcher.pipeline import warm_up

    warm_up()
    scene = csg_renderer.load_scene(csg_renderer.scene_path('l_shape_v1'))
    csg_renderer.render_stereo(scene, csg_renderer.default_rig(scene))


def main() -> int:
    with ProcessPoolExecutor(2, mp_context=get_context('spawn')) as pool:
        for job in [pool.submit(compile_recovery), pool.submit(compile_matcher_and_renderer)]:
            job.result()
    return 0


if __name__ == '__main__':
    sys.exit(main())
