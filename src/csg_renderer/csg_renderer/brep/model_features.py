"""Matching features of a model: exact straight edges, planar curves and axes from its CSG tree (thesis 4.12, 6.3)."""

from __future__ import annotations

from weakref import WeakKeyDictionary

from msgs_py import FeatureSet

from ..scene.solid import Solid
from .boundary import Boundary, evaluate

# Solids are immutable, and a program uses the features of one model many times.
_known: WeakKeyDictionary[Solid, Boundary] = WeakKeyDictionary()


def boundary(solid: Solid) -> Boundary:
    """Evaluate a solid's boundary; the result is kept as long as the solid.

    Parameters
    ----------
    solid : Solid

    Returns
    -------
    Boundary
        Creases, axes and, in ``details``, faces, vertices, angles, area and volume; model frame, metres.

    Raises
    ------
    ValueError
        ``solid`` is no Solid, or a terrain is part of it.

    Examples
    --------
    >>> found = boundary(Solid.block(1.0, 2.0, 3.0))
    >>> len(found.details.faces), round(float(found.details.volume), 9)
    (6, 6.0)
    """
    if not isinstance(solid, Solid):
        raise ValueError(f'solid: expected a Solid, got {type(solid).__name__}')
    found = _known.get(solid)
    if found is None:
        found = _known[solid] = evaluate(solid)
    return found


def model_features(solid: Solid) -> FeatureSet:
    """The matching features of a solid: all its sharp straight edges, then planar curves, then axes.

    Parameters
    ----------
    solid : Solid

    Returns
    -------
    FeatureSet
        Model frame, metres, uncertainty zero.

    Raises
    ------
    ValueError
        ``solid`` is no Solid, or a terrain is part of it.

    References
    ----------
    Thesis 4.12 and 6.3.

    Examples
    --------
    >>> features = model_features(Solid.cylinder(0.5, (0.0, 0.0, 2.0)))
    >>> features.kind.tolist(), features.radii[0].tolist()  # two circles and the axis
    ([1, 1, 2], [0.5, 0.5])
    """
    return boundary(solid).features
