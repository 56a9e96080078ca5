"""What the libraries return prints in a line: who looks at a result does not want its arrays."""

from __future__ import annotations

import csg_renderer
from csg_renderer import SolidOutline
from csg_renderer.raycast.render import scene_rig
from model_matcher.image_pose.views import Views
from model_matcher.pipeline import index_model, survey
from stereo_recovery import recover

# Characters: what fits on a few lines of a terminal.
SHORT = 800


def test_results_print_without_their_arrays():
    scene = csg_renderer.load_scene(csg_renderer.scene_path('l_shape_v1'))
    rig = scene_rig(scene, width=256)
    frames = csg_renderer.render_stereo(scene, rig)
    images = [frame.image[..., 0] for frame in frames]
    recovery = recover(*images, rig)
    solid = scene.placements[0].model
    model = index_model(csg_renderer.model_features(solid), 'l_shape', SolidOutline(solid))
    result = survey([model], recovery.features, views=Views.of(images, rig))
    assert result
    for one, says in (
        (frames[0], 'camera='),
        (recovery, '15 EDGE'),
        (result, "Interpretation('l_shape'"),
        (result.outlines[0], 'support='),
    ):
        assert says in repr(one) and 'array(' not in repr(one) and len(repr(one)) < SHORT, repr(one)[:SHORT]
