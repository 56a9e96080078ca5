"""The unit of a mesh, which its file does not say: given, or guessed from its size against the working distance."""

from __future__ import annotations

from typing import NamedTuple

from .settings import LARGEST_SHARE, LEAST_SHARE, WORKING_DISTANCE

# Metres per unit, in the order of the guesses: CAD programs write millimetres, models of robots (REP-103) metres.
METRES = {'mm': 1e-3, 'm': 1.0, 'in': 0.0254, 'cm': 1e-2}
GUESS = 'guess'
MESH_UNITS = (GUESS, 'mm', 'cm', 'm', 'in')


class MeshUnit(NamedTuple):
    """The unit of one mesh.

    Attributes
    ----------
    name : str
        Of METRES.
    guessed : bool
        Nobody has said it.
    extent : float
        Diagonal of the mesh's box, units of its file.
    """

    name: str
    guessed: bool
    extent: float

    @property
    def metres(self) -> float:
        """Metres per unit."""
        return METRES[self.name]

    def __str__(self) -> str:
        return f'{self.extent:.4g} {self.name} across' + (
            ' (guessed; mesh_units says otherwise)' if self.guessed else ''
        )


def mesh_unit(extent: float, units: str = GUESS, distance: float = WORKING_DISTANCE) -> MeshUnit:
    """The unit that is given, or the first in which a mesh is of a size that can be seen from the working distance.

    Parameters
    ----------
    extent : float
        Diagonal of the mesh's box, units of its file.
    units : str
        One of MESH_UNITS.
    distance : float
        Metres, at which it will be looked at.

    Returns
    -------
    MeshUnit

    Raises
    ------
    ValueError
        The units or the distance are none.

    Examples
    --------
    >>> [mesh_unit(extent).name for extent in (120.0, 0.12, 6.0)]
    ['mm', 'm', 'in']
    >>> mesh_unit(120.0, 'cm').metres
    0.01
    """
    if units not in MESH_UNITS:
        raise ValueError(f'mesh_units: expected one of {", ".join(MESH_UNITS)}; got {units!r}')
    if not distance > 0.0:
        raise ValueError(f'distance: expected metres > 0, got {distance}')
    if units != GUESS:
        return MeshUnit(units, False, extent)

    def misfit(name: str) -> float:
        """By what factor a unit makes it too small or too large."""
        share = extent * METRES[name] / distance
        return max(LEAST_SHARE / share if share > 0.0 else float('inf'), share / LARGEST_SHARE, 1.0)

    return MeshUnit(min(METRES, key=misfit), True, extent)
