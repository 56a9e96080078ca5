"""Finds known objects among recovered 3D features: interpretation search, validation, closed-form testing."""

from .catalogue.catalogue import open_catalogue
from .model.index import ModelIndex, index_model
from .params import MatchParams, MatchResult
from .pipeline import match, recognise
from .tracking.tracker import Tracked, Tracker, TrackParams

__all__ = [
    'MatchParams',
    'MatchResult',
    'ModelIndex',
    'TrackParams',
    'Tracked',
    'Tracker',
    'index_model',
    'match',
    'open_catalogue',
    'recognise',
]
