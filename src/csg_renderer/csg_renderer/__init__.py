"""Constructive solid geometry: modelling language, exact ray caster, model features, renderer node."""

from msgs_py.renaming import renamed_names

from .brep.model_features import boundary, model_features
from .features.collision_shapes import planning_scene
from .features.ideal_data import Degradation, IdealData, ideal_data
from .features.library import KnownModel, load_known_models, load_model_features
from .features.mesh_features import features_from_mesh
from .features.mesh_outline import MeshOutline
from .language import SceneError, SceneWarning, load_models, load_scene, parse_scene, scene_names, scene_path
from .raycast.frame import Frame, RenderOptions, RenderStats
from .raycast.render import default_camera, default_rig, render, render_stereo
from .raycast.sensor import SensorModel
from .scene.scene import Light, Placement, Scene
from .scene.solid import Solid, Surface
from .scene.terrain import Terrain
from .scene.textures import Environment, Texture
from .visibility.hidden_lines import visible_features, visible_fragments
from .visibility.outline import SolidOutline

__all__ = [
    'Degradation',
    'Environment',
    'Frame',
    'IdealData',
    'KnownModel',
    'Light',
    'MeshOutline',
    'Placement',
    'RenderOptions',
    'RenderStats',
    'Scene',
    'SceneError',
    'SceneWarning',
    'SensorModel',
    'Solid',
    'SolidOutline',
    'Surface',
    'Terrain',
    'Texture',
    'Wear',
    'boundary',
    'default_camera',
    'default_rig',
    'features_from_mesh',
    'ideal_data',
    'load_known_models',
    'load_model_features',
    'load_models',
    'load_scene',
    'model_features',
    'parse_scene',
    'planning_scene',
    'render',
    'render_stereo',
    'scene_names',
    'scene_path',
    'visible_features',
    'visible_fragments',
]

# Degradation was called Wear up to 0.1.
__getattr__ = renamed_names(__name__, {'Wear': 'Degradation'})
