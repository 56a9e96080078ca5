"""The features of model files of all kinds: the one way in for tools and nodes that take a model."""

from __future__ import annotations

import os
from pathlib import Path

from msgs_py import FeatureSet

from ..brep.model_features import model_features
from ..language import load_models
from ..scene.terrain import sheets
from ..visibility.outline import SolidOutline
from .mesh_features import MESH_SUFFIXES, features_from_mesh

SCENE_SUFFIX = '.csg'
FEATURE_SUFFIX = '.npz'
MODEL_SUFFIXES = (SCENE_SUFFIX, FEATURE_SUFFIX, *MESH_SUFFIXES)


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
    suffix = Path(path).suffix.lower()
    if suffix in MESH_SUFFIXES:
        return {Path(path).stem: features_from_mesh(path, scale=mesh_scale)}
    if suffix == FEATURE_SUFFIX:
        return {Path(path).stem: FeatureSet.load(Path(path))}
    return {name: model_features(solid) for name, solid in load_models(path).items()}


def load_model_outlines(path: str | os.PathLike[str]) -> dict[str, SolidOutline]:
    """What cameras see of the models in a file, for those of which more than features is known.

    Parameters
    ----------
    path : str or path
        As for :func:`load_model_features`.

    Returns
    -------
    dict of str to SolidOutline
        By the model's name; empty for a feature file or a mesh.

    Raises
    ------
    FileNotFoundError, SceneError
        As :func:`load_model_features`.

    Examples
    --------
    >>> round(load_model_outlines('l_shape')['l_shape'].size, 3)
    0.062
    """
    if Path(path).suffix.lower() in (*MESH_SUFFIXES, FEATURE_SUFFIX):
        return {}
    return {name: SolidOutline(solid) for name, solid in load_models(path).items() if not sheets(solid)}
