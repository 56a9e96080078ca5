"""Matching features of a model: exact straight edges, planar curves and axes from its CSG tree (thesis 4.12, 6.3)."""

from __future__ import annotations

from weakref import WeakKeyDictionary

from msgs_py import FeatureSet

from ..scene.solid import Solid
from .boundary import Boundary, evaluate

# Solids never change, and a program asks for the same model's features again and again.
_known: WeakKeyDictionary[Solid, Boundary] = WeakKeyDictionary()


def boundary(solid: Solid) -> Boundary:
    """Everything known of the solid's boundary, model frame, metres. Remembered as long as the solid lives.

    Raises ValueError when solid is no Solid.
    """
    if not isinstance(solid, Solid):
        raise ValueError(f'solid: expected a Solid, got {type(solid).__name__}')
    found = _known.get(solid)
    if found is None:
        found = _known[solid] = evaluate(solid)
    return found


def model_features(solid: Solid) -> FeatureSet:
    """All sharp straight edges, then planar curves, then axes of a solid; model frame, metres, uncertainty zero."""
    return boundary(solid).features
