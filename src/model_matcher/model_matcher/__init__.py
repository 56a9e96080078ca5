"""Finds known objects among recovered 3D features: interpretation search, validation, closed-form testing."""

from .model.index import ModelIndex, index_model
from .params import MatchParams, MatchResult
from .pipeline import match, recognise

__all__ = ['MatchParams', 'MatchResult', 'ModelIndex', 'index_model', 'match', 'recognise']
