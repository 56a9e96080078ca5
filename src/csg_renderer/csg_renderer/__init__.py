"""Constructive solid geometry: modelling language, exact ray caster, model features, renderer node."""

from .frame import Frame, RenderOptions, RenderStats
from .language import SceneError, SceneWarning, load_models, load_scene, parse_scene, scene_names, scene_path
from .model_features import boundary, model_features
from .pipeline import default_camera, default_rig, render, render_stereo
from .scene import Light, Placement, Scene
from .solid import Solid, Surface
from .visibility import visible_features, visible_fragments

__all__ = ['Frame', 'Light', 'Placement', 'RenderOptions', 'RenderStats', 'Scene', 'SceneError', 'SceneWarning',
           'Solid', 'Surface', 'boundary', 'default_camera', 'default_rig', 'load_models', 'load_scene',
           'model_features', 'parse_scene', 'render', 'render_stereo', 'scene_names', 'scene_path', 'visible_features',
           'visible_fragments']
