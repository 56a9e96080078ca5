"""Model features and their visible parts, straight from the CSG tree, for every scene of csg_renderer."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from measure import Absent, Measurement, milliseconds

from csg_renderer import Solid, default_camera, load_scene, model_features, scene_names, scene_path, visible_features
from msgs_py import FeatureSet

QUICK = 6


def fresh_model_features(solid: Solid) -> FeatureSet:
    """A solid remembers its boundary; a moved copy has to find it again."""
    return model_features(solid.transformed(np.eye(4)))


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    seen = set()
    for name in scene_names():
        scene = load_scene(scene_path(name))
        if not scene.placements or (quick and len(seen) >= QUICK):
            continue
        placement = scene.placements[0]
        budget = 0.1 if quick else 0.4
        try:
            model = model_features(placement.model)
            if placement.name not in seen:
                seen.add(placement.name)
                yield Measurement(
                    f'model features of {placement.name} ({len(model)} features)',
                    milliseconds(partial(fresh_model_features, placement.model), budget),
                )
            if scene.camera is None:
                continue
            pose = scene.camera_T_scene.compose(placement.pose)
            camera = scene.camera or default_camera()
            yield Measurement(
                f'visible features of {name}',
                milliseconds(partial(visible_features, placement.model, pose, camera), budget),
            )
        except (ValueError, NotImplementedError) as error:
            yield Absent(f'features of {name}', str(error))
