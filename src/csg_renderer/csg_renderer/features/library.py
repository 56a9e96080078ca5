"""The features of model files of all kinds: the one way in for tools and nodes that take a model."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from msgs_py import FeatureSet, Pose

from ..brep.model_features import model_features
from ..language import load_placements
from ..mesh.files import MESH_SUFFIXES, read_mesh
from ..mesh.settings import WORKING_DISTANCE
from ..mesh.units import MeshUnit, mesh_unit
from ..visibility.outline import SolidOutline
from .mesh_outline import MeshOutline

SCENE_SUFFIX = '.csg'
FEATURE_SUFFIX = '.npz'
MODEL_SUFFIXES = (SCENE_SUFFIX, FEATURE_SUFFIX, *MESH_SUFFIXES)


# What is known of a model besides its features: what a camera sees of it.
ModelOutline: TypeAlias = SolidOutline | MeshOutline


class KnownModel(NamedTuple):
    """What is known of a model.

    Attributes
    ----------
    features : FeatureSet
        Model frame, metres.
    outline : SolidOutline or MeshOutline, optional
        What cameras see of it; None of a feature file.
    unit : MeshUnit, optional
        Of a mesh, where ``mesh_units`` was asked for.
    frames : dict of str to Pose
        Named frames of a scene file's model (FRAME), model_T_frame.
    """

    features: FeatureSet
    outline: ModelOutline | None
    unit: MeshUnit | None = None
    frames: dict[str, Pose] = {}


def load_model_features(path: str | os.PathLike[str], *, mesh_scale: float = 1.0) -> dict[str, FeatureSet]:
    """Read the matching features of every model in a file.

    Parameters
    ----------
    path : str or path
        A scene file (.csg) or the name of a scene of this package, which gives one model for each object that it
        draws; a mesh (.stl, .obj, .ply, .off) or a feature file (.npz, of :meth:`FeatureSet.save`), which is one
        model with the file's name.
    mesh_scale : float
        Metres per unit of a mesh, whose file does not say what its unit is. Scenes and feature files need none.

    Returns
    -------
    dict of str to FeatureSet
        Features by the model's name, model frame, metres.

    Raises
    ------
    FileNotFoundError
        There is no such file or scene.
    SceneError
        A scene file has a mistake; the error has its line and column.
    ValueError
        A mesh or a feature file cannot be used; the message begins with its name.

    Examples
    --------
    >>> features = load_model_features('l_shape')['l_shape']
    >>> len(features), round(float(features.lengths.max()), 3)
    (18, 0.056)
    """
    return {name: known.features for name, known in load_known_models(path, mesh_scale=mesh_scale).items()}


def load_known_models(
    path: str | os.PathLike[str],
    *,
    mesh_scale: float = 1.0,
    mesh_units: str | None = None,
    distance: float = WORKING_DISTANCE,
) -> dict[str, KnownModel]:
    """Read all that matching and measuring need of every model in a file.

    Parameters
    ----------
    path, mesh_scale
        As for :func:`load_model_features`, which raises the same.
    mesh_units : str, optional
        One of :data:`..mesh.units.MESH_UNITS`, in place of ``mesh_scale``; what was taken stands in ``unit``.
    distance : float
        Metres, at which models will be looked at: what a guess of the unit goes by.

    Returns
    -------
    dict of str to KnownModel
        By the model's name.

    Examples
    --------
    >>> known = load_known_models('l_shape')['l_shape']
    >>> len(known.features), known.outline is None
    (18, False)
    """
    suffix = Path(path).suffix.lower()
    if suffix in MESH_SUFFIXES:
        if not 0.0 < mesh_scale < np.inf:
            raise ValueError(f'mesh_scale: expected metres per unit > 0, got {mesh_scale}')
        vertices, triangles = read_mesh(path)
        unit = None
        if mesh_units is not None:
            unit = mesh_unit(float(np.linalg.norm(np.ptp(vertices, axis=0))), mesh_units, distance)
        outline = MeshOutline((mesh_scale if unit is None else unit.metres) * vertices, triangles)
        return {Path(path).stem: KnownModel(outline.features, outline, unit)}
    if suffix == FEATURE_SUFFIX:
        return {Path(path).stem: KnownModel(FeatureSet.load(Path(path)), None)}
    return {
        one.name: KnownModel(model_features(one.model), SolidOutline(one.model), frames=one.frames)
        for one in load_placements(path)
    }
