"""Constructive solid geometry: modelling language, exact ray caster, model features, renderer node."""

from .frame import Frame, RenderOptions, RenderStats
from .pipeline import default_camera, default_rig, render, render_stereo
from .scene import Light, Placement, Scene
from .solid import Solid, Surface

__all__ = ['Frame', 'Light', 'Placement', 'RenderOptions', 'RenderStats', 'Scene', 'Solid', 'Surface', 'default_camera',
           'default_rig', 'render', 'render_stereo']
