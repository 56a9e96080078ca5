"""Poses of named objects in the images of several calibrated cameras, as the benchmarks ask for them."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from msgs_py import CameraRig, Interpretation, Pose
from msgs_py.numeric.typed import ByteArray
from stereo_recovery import recover

from ...image_pose.views import Views
from ...model.index import ModelIndex
from ...model.library import load_library
from ...pipeline import survey
from .results import BopResult
from .scene_folder import BopScene, model_files, rig_of


@dataclass(frozen=True, eq=False)
class Estimate:
    """An object that was found.

    Attributes
    ----------
    object_id : int
    score : float
        Evidence, nats: of two answers that with more is the surer.
    pose : Pose
        first_T_model, metres.
    """

    object_id: int
    score: float
    pose: Pose


def load_models(folder: Path) -> dict[int, ModelIndex]:
    """The models of a folder by their objects' numbers; meshes are in millimetres.

    Raises
    ------
    ValueError
        There are none, or one cannot be used; names the file.
    """
    models = {}
    for number, path in model_files(folder).items():
        library = load_library([str(path)], 'mm')
        if not library.models:
            raise ValueError('; '.join(library.problems) or f'{path}: holds no model')
        models[number] = library.models[0]
    return models


def estimates(
    models: Mapping[int, ModelIndex], wanted: Iterable[int], images: Sequence[ByteArray], rig: CameraRig
) -> list[Estimate]:
    """Find objects in images of one moment.

    Parameters
    ----------
    models : mapping of int to ModelIndex
        By the objects' numbers.
    wanted : iterable of int
        The objects to look for; as many instances of each as there are.
    images : sequence of (h, w) uint8
        Free of distortion, one for each camera.
    rig : CameraRig

    Returns
    -------
    list of Estimate
        The surest first.

    Raises
    ------
    ValueError
        An object whose model is not known.
    """
    chosen = {}
    for number in sorted(set(wanted)):
        if number not in models:
            raise ValueError(f'object {number}: no model of it is known, only of {", ".join(map(str, sorted(models)))}')
        chosen[models[number].name] = number
    features = recover(images, rig).features
    found = survey([models[number] for number in chosen.values()], features, views=Views.of(images, rig))
    made = [Estimate(chosen[one.model], _score(one), one.pose) for one in found.interpretations]
    return sorted(made, key=lambda one: -one.score)


def answer_scene(
    scene: BopScene,
    models: Mapping[int, ModelIndex],
    objects: Sequence[int] | None = None,
    views: int = 3,
    targets: Mapping[int, Sequence[int]] | None = None,
) -> Iterator[list[BopResult]]:
    """Answer the images of a scene.

    Of several cameras (rgb_cam1, rgb_cam2, ...) the images of one number belong together, and poses are those in the
    world, as the challenge has it. Of one camera that moved through a scene that did not, each image is answered with
    the ``views - 1`` that follow it, and poses are those in its camera, as BOP has it.

    Parameters
    ----------
    scene : BopScene
    models : mapping of int to ModelIndex
        By the objects' numbers.
    objects : sequence of int, optional
        What to look for; else what is asked for in an image, what its annotations name, or every model.
    views : int
        Images of one camera that are taken together.
    targets : mapping of int to sequence of int, optional
        By the number of an image, the objects asked for in it; images that are not named are not answered.

    Yields
    ------
    list of BopResult
        Of one image.

    Raises
    ------
    OSError, ValueError
        Names the image, camera or object that cannot be used.
    """
    several = len(scene.cameras) > 1
    first = scene.cameras[0]
    numbers = sorted(scene.images[first])
    if not several and (views < 2 or len(numbers) < 2):
        raise ValueError(f'{scene.folder}: recovery needs two images or more of cameras with a distance between them')
    for place, number in enumerate(numbers):
        if targets is not None and number not in targets:
            continue
        began = time.perf_counter()
        if several:
            missing = [name for name in scene.cameras if number not in scene.images[name]]
            if missing:
                raise ValueError(f'{scene.folder}: image {number} is missing of {", ".join(missing)}')
            together = {name: scene.images[name][number] for name in scene.cameras}
        else:
            taken = [numbers[(place + k) % len(numbers)] for k in range(min(views, len(numbers)))]
            together = {f'image {one}': scene.images[first][one] for one in taken}
        pixels = [image.read() for image in together.values()]
        rig, first_T_world = rig_of(together, [(one.shape[1], one.shape[0]) for one in pixels])
        annotated = scene.truth.get(first, {}).get(number)
        known = sorted(models) if annotated is None else sorted({one.object_id for one in annotated})
        wanted = objects or (known if targets is None else targets[number] or sorted(models))
        found = estimates(models, wanted, pixels, rig)
        seconds = time.perf_counter() - began
        base_T_first = first_T_world.inverse() if several else Pose.identity()
        yield [
            BopResult(scene.number, number, one.object_id, one.score, base_T_first.compose(one.pose), seconds)
            for one in found
        ]


def _score(found: Interpretation) -> float:
    """Evidence; what was matched where it was not weighed."""
    return found.evidence if math.isfinite(found.evidence) else float(found.matched)
