"""The modelling language: text to scenes and back (thesis 3.6, 4.10)."""

from .errors import SceneError, SceneWarning
from .loader import (
    SceneFile,
    find_scene,
    load_models,
    load_placements,
    load_scene,
    parse_scene,
    read_scene,
    read_text,
    same_geometry,
    scene_names,
    scene_path,
)
from .printer import format_scene

__all__ = [
    'SceneError',
    'SceneFile',
    'SceneWarning',
    'find_scene',
    'format_scene',
    'load_models',
    'load_placements',
    'load_scene',
    'parse_scene',
    'read_scene',
    'read_text',
    'same_geometry',
    'scene_names',
    'scene_path',
]
