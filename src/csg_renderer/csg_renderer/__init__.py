"""Constructive solid geometry: modelling language, exact ray caster, model features, renderer node."""

from .frame import Frame, RenderOptions, RenderStats
from .model_features import boundary, model_features
from .pipeline import default_camera, default_rig, render, render_stereo
from .scene import Light, Placement, Scene
from .solid import Solid, Surface
from .visibility import visible_features, visible_fragments

__all__ = ['Frame', 'Light', 'Placement', 'RenderOptions', 'RenderStats', 'Scene', 'Solid', 'Surface', 'boundary',
           'default_camera', 'default_rig', 'model_features', 'render', 'render_stereo', 'visible_features',
           'visible_fragments']
