"""Constructive solid geometry: modelling language, exact ray caster, model features, renderer node."""

from .scene import Light, Placement, Scene
from .solid import Solid, Surface

__all__ = ['Light', 'Placement', 'Scene', 'Solid', 'Surface']
