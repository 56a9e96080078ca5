"""Counts that the thesis prints of its scenes: the figures that ours are held against.

None stands where the thesis prints no number. The dimensions of its models are lost; those of the scene files that come
with this package are chosen so that these counts come out.

Examples
--------
>>> MODELS['l_shape'].edges, VIEWS['l_shape_v1'].total
(18, 15)
"""

from __future__ import annotations

from typing import NamedTuple


class ModelCounts(NamedTuple):
    """A model: its primitives, half-spaces and faces, and its straight edges, planar curves and axes."""

    primitives: int | None
    halfspaces: int | None
    faces: int | None
    edges: int
    curves: int
    axes: int


class ViewCounts(NamedTuple):
    """A view of a model: the straight edges, planar curves and axes that are data."""

    edges: int
    curves: int
    axes: int

    @property
    def total(self) -> int:
        """Number of data features."""
        return sum(self)


class SceneCounts(NamedTuple):
    """A scene for the ray caster alone: its primitives and half-spaces, and its edges where they are printed."""

    primitives: int
    halfspaces: int | None
    edges: int | None


# Primitives and half-spaces: Table 5.1, the plug's section 5.11.5. Faces and edges: Table 5.3, the plug's section
# 5.11.5; planar faces, edges, curves and axes of cylinder_box, lamp and tubes: Table 6.1; the widget's section 6.9.1.
MODELS: dict[str, ModelCounts] = {
    'chipped_block': ModelCounts(2, 12, 7, 15, 0, 0),
    'chair': ModelCounts(3, 18, 12, 30, 0, 0),
    'computer': ModelCounts(9, 54, 14, 32, 0, 0),
    'l_shape': ModelCounts(2, 12, 8, 18, 0, 0),
    'wedge': ModelCounts(3, 18, 7, 15, 0, 0),
    'plug': ModelCounts(8, 48, None, 54, 0, 0),
    'cylinder_box': ModelCounts(None, None, 7, 12, 2, 1),
    'lamp': ModelCounts(None, None, 13, 24, 3, 1),
    'tubes': ModelCounts(None, None, 10, 0, 10, 5),
    'widget': ModelCounts(None, None, None, 28, 3, 1),
}

# Data of rendered scenes. Polyhedra: ideal data (Table 5.6, the plug's section 5.11.5). Models with curves: recovered
# data (Table 6.2), where a fragmented edge counts once for each fragment.
VIEWS: dict[str, ViewCounts] = {
    'chipped_block_v1': ViewCounts(12, 0, 0),
    'chipped_block_v2': ViewCounts(9, 0, 0),
    'chair_v1': ViewCounts(20, 0, 0),
    'chair_v2': ViewCounts(21, 0, 0),
    'computer_v1': ViewCounts(26, 0, 0),
    'computer_v2': ViewCounts(17, 0, 0),
    'l_shape_v1': ViewCounts(15, 0, 0),
    'l_shape_v2': ViewCounts(9, 0, 0),
    'wedge_v1': ViewCounts(12, 0, 0),
    'wedge_v2': ViewCounts(8, 0, 0),
    'plug_v1': ViewCounts(40, 0, 0),
    'plug_v2': ViewCounts(13, 0, 0),
    'cylinder_box_v1': ViewCounts(9, 2, 1),
    'cylinder_box_v2': ViewCounts(11, 1, 0),
    'lamp_v1': ViewCounts(16, 3, 1),
    'lamp_v2': ViewCounts(15, 2, 1),
    'tubes_v1': ViewCounts(0, 8, 3),
}

# Data recovered from a real stereo pair (Table 6.5); our scenes of these names stand at about the printed poses.
REAL_VIEWS: dict[str, ViewCounts] = {'widget_v1': ViewCounts(15, 3, 1), 'widget_v2': ViewCounts(15, 2, 0)}

# Table 4.3; the table of Plate 4.1 from section 4.12, which also gives the edges of the oil rig.
SCENES: dict[str, SceneCounts] = {
    'coverplate': SceneCounts(25, 93, None),
    'recursive_cubes': SceneCounts(42, 147, None),
    'oil_rig': SceneCounts(44, 264, 498),
    'robot_arm': SceneCounts(63, 258, None),
    'geneva_wheel': SceneCounts(38, 147, None),
    'table': SceneCounts(100, None, None),
}
