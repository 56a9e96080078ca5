"""BOP scenes answered and scored: average recall by MSSD, MSPD and, where the folder has depth, VSD.

    python test/benchmarks/bench_bop.py                                   # a small data set of our own, rendered
    python test/benchmarks/bench_bop.py --scenes ipd/val/0000* --models ipd/models
    python test/benchmarks/bench_bop.py --scenes ... --models ... --results result.csv     # somebody's answers

Data sets of the benchmark are not part of the project (docs: src/model_matcher/docs/benchmarks.md).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from bop_scenes import write_models, write_scene
from bop_scoring import VSD_DELTA, Judged, Recall, mesh_depth, mspd, mssd, symmetry_poses, vsd

from csg_renderer.mesh.files import read_mesh
from model_matcher.closed_form.bop.answer import answer_scene, load_models
from model_matcher.closed_form.bop.results import BopResult, read_results
from model_matcher.closed_form.bop.scene_folder import BopScene, ModelInfo, read_models_info, read_scene
from msgs_py import Pose

TO_MM = 1e3


class Judge:
    """What answers are scored against."""

    def __init__(self, models: Path, info: dict[int, ModelInfo], delta: float = VSD_DELTA) -> None:
        self.delta = delta
        self.meshes = {number: read_mesh(models / f'obj_{number:06d}.ply') for number in info}
        self.info = info
        self.symmetries = {number: symmetry_poses(one) for number, one in info.items()}

    def image(self, scene: BopScene, number: int, results: Iterable[BopResult]) -> list[Judged]:
        """Score the answers of one image, object by object; poses are taken to the scene's first camera."""
        name = scene.cameras[0]
        view = scene.images[name][number]
        pixels = view.read()
        size = (pixels.shape[1], pixels.shape[0])
        depth = read_depth(scene, name, number)
        several = len(scene.cameras) > 1
        found: dict[int, list[BopResult]] = {}
        for one in sorted(results, key=lambda one: -one.score):
            found.setdefault(one.object_id, []).append(one)
        true: dict[int, list[Pose]] = {}
        for one in scene.truth[name][number]:
            true.setdefault(one.object_id, []).append(_millimetres(one.pose))
        judged = []
        for part, poses in true.items():
            # As many answers as there are instances, as in the task of localization.
            answers = [
                _millimetres(view.camera_T_world.compose(one.pose) if several else one.pose)
                for one in found.get(part, [])[: len(poses)]
            ]
            judged.append(self.part(part, answers, poses, view.matrix, size, depth))
        return judged

    def part(
        self,
        number: int,
        answers: Sequence[Pose],
        true: Sequence[Pose],
        matrix: np.ndarray,
        size: tuple[int, int],
        depth: np.ndarray | None,
    ) -> Judged:
        """Errors of every answer against every true pose; millimetres."""
        (points, faces), symmetries = self.meshes[number], self.symmetries[number]
        diameter = self.info[number].diameter
        shape = (len(answers), len(true))
        surface = [[mssd(a, t, points, symmetries) / diameter for t in true] for a in answers]
        drawn = [[mspd(a, t, points, symmetries, matrix) * 640.0 / size[0] for t in true] for a in answers]
        visible = None
        if depth is not None:
            depths = [[mesh_depth(points, faces, pose, matrix, size) for pose in ones] for ones in (answers, true)]
            visible = np.array(
                [[vsd(a, t, depth, matrix, diameter, delta=self.delta) for t in depths[1]] for a in depths[0]]
            )
            visible = visible.reshape(*shape, -1) if visible.size else np.zeros((*shape, 10))
        return Judged(np.array(surface).reshape(shape), np.array(drawn).reshape(shape), visible)


def read_depth(scene: BopScene, name: str, number: int) -> np.ndarray | None:
    """Depth image of a camera, millimetres; None where the folder has none."""
    ending = f'_{name}' if name else ''
    path = scene.folder / f'depth{ending}' / f'{number:06d}.png'
    steps = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.exists() else None
    if steps is None:
        return None
    cameras = json.loads((scene.folder / f'scene_camera{ending}.json').read_text())
    return np.asarray(steps * cameras[str(number)]['depth_scale'], float)


def _millimetres(pose: Pose) -> Pose:
    return Pose(pose.rotation, TO_MM * pose.translation)


def score(
    folders: Sequence[Path], models: Path, results: Path | None = None, views: int = 3, delta: float = VSD_DELTA
) -> Recall:
    """Answer scenes, or take somebody's answers, and count what was found."""
    judge = Judge(models, read_models_info(models / 'models_info.json'), delta)
    known = None if results is not None else load_models(models)
    given = [] if results is None else read_results(results)
    recall = Recall()
    for folder in folders:
        scene = read_scene(folder)
        numbers = sorted(scene.images[scene.cameras[0]])
        answers = (
            ([one for one in given if (one.scene_id, one.image_id) == (scene.number, k)] for k in numbers)
            if known is None
            else answer_scene(scene, known, views=views)
        )
        for number, answer in zip(numbers, answers, strict=True):
            for judged in judge.image(scene, number, answer):
                recall.add(judged)
    return recall


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--scenes', nargs='+', type=Path, help='folders of scenes (default: our own, rendered)')
    parser.add_argument('--models', type=Path, help='folder of their models')
    parser.add_argument('--results', type=Path, help='score this file of answers')
    parser.add_argument('--views', type=int, default=3, help='images of one camera that are taken together')
    parser.add_argument('--images', type=int, default=6, help='of our own')
    parser.add_argument('--delta', type=float, default=VSD_DELTA, metavar='MM', help='of VSD (default: 15; ITODD: 5)')
    options = parser.parse_args(arguments)
    if (options.scenes is None) != (options.models is None):
        parser.error('--scenes and --models go together')
    with tempfile.TemporaryDirectory() as folder:
        if options.scenes is None:
            write_models(Path(folder, 'models'))
            write_scene(Path(folder, '000001'), options.images)
            options.scenes, options.models = [Path(folder, '000001')], Path(folder, 'models')
        recall = score(options.scenes, options.models, options.results, options.views, options.delta)
    print(f'{recall.true} true poses')
    for name, value in recall.average().items():
        print(f'{name:<6}{value:.3f}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
