"""One way in for every tool and node that takes a model: scene files and CAD meshes alike."""

from __future__ import annotations

import os
from pathlib import Path

from msgs_py import FeatureSet

from ..brep.model_features import model_features
from ..language import load_models
from .mesh_features import MESH_SUFFIXES, features_from_mesh


def load_model_features(path: str | os.PathLike[str], *, mesh_scale: float = 1.0) -> dict[str, FeatureSet]:
    """The features of every model in a .csg, .stl, .obj or .ply file, by the model's name; model frame, metres.

    A mesh is one model with the file's name; mesh_scale is its metres per unit.
    Raises FileNotFoundError, SceneError for a scene file, ValueError for a mesh; each names the file.
    """
    if Path(path).suffix.lower() in MESH_SUFFIXES:
        return {Path(path).stem: features_from_mesh(path, scale=mesh_scale)}
    return {name: model_features(solid) for name, solid in load_models(path).items()}
