"""Figures printed in the thesis, with where they stand. Lengths in mm, times in seconds, rotations row-form.

Only what has survived as text: figures 4.15 to 5.28 and 6.10 to 6.13 are lost except for what the text says of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ThesisView:
    """One test view: what the thesis prints about it; None where it does not.

    ideal : visible data features (Tables 5.6, 6.2); fragments : recovered ones (Tables 5.8, 6.2, 6.5)
    err_par, err_per, cone_deg : Tables 5.8, 6.3, 6.6; stereo_s : Table 5.2; rotation, translation : true (5.9, 5.12,
    6.4, 6.7); found_rotation, found_translation : computed (5.10, 5.13, 6.4, 6.7)
    """

    ideal: int | None
    fragments: int | None
    err_par: float | None
    err_per: float | None
    cone_deg: float | None
    stereo_s: float | None
    rotation: tuple[float, ...]
    translation: tuple[float, float, float]
    found_rotation: tuple[float, ...]
    found_translation: tuple[float, float, float] | None

    @property
    def rotation_error_deg(self) -> float:
        """Angle between the printed matrices, each made orthonormal first (four printed digits: 0.005 deg)."""
        a, b = (_orthonormal(m) for m in (self.rotation, self.found_rotation))
        return float(np.degrees(np.linalg.norm(_vector(a @ b.T))))

    @property
    def translation_error_mm(self) -> np.ndarray | None:
        if self.found_translation is None:
            return None
        return np.abs(np.subtract(self.found_translation, self.translation))


def _orthonormal(numbers: tuple[float, ...]) -> np.ndarray:
    u, _, v = np.linalg.svd(np.reshape(numbers, (3, 3)))
    return u @ v


def _vector(rotation: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation
    return Rotation.from_matrix(rotation).as_rotvec()


VIEWS: dict[str, ThesisView] = {
    'chipped_block_v1': ThesisView(
        12, 12, 5, 5, 5, 12.6, (.7660, -.2198, -.6040, 0, .9397, -.3420, .6428, .2620, .7198), (60, -40, 350),
        (.7608, -.2171, -.6116, -.0058, .9401, -.3409, .6490, .2629, .7140), (61.14, -39.86, 350.51)),
    'chipped_block_v2': ThesisView(
        9, 9, 5, 5, 10, 10.3, (0, -.7660, .6428, -.6428, .4924, .5868, -.7660, -.4132, -.4924), (-80, -50, 300),
        (-.0013, -.7638, .6455, -.6426, .4952, .5847, -.7662, -.4140, -.4915), (-80.52, -48.79, 300.80)),
    'chair_v1': ThesisView(
        20, 21, 5, 5, 10, 12.1, (.5, -.5567, -.6634, 0, .7660, -.6428, .8660, .3214, .3830), (10, -50, 200),
        (.5062, -.5588, -.6569, .0063, .7641, -.6451, .8624, .3224, .3903), (9.59, -49.97, 201.93)),
    'chair_v2': ThesisView(
        21, 20, 5, 5, 10, 9.6, (.7660, 0, -.6428, .5567, -.5, .6634, -.3214, -.8660, -.3830), (-20, 0, 150),
        (.7731, -.0050, -.6342, .5486, -.4967, .6726, -.3184, -.8679, -.3812), (-19.07, -.47, 151.04)),
    'computer_v1': ThesisView(
        26, 26, 5, 5, 15, 32.8, (.7660, -.4132, -.4924, 0, .7660, -.6428, .6428, .4924, .5868), (70, -20, 300),
        (.7650, -.4026, -.5026, .0043, .7836, -.6212, .6440, .4731, .6012), (69.62, -22.50, 300.91)),
    'computer_v2': ThesisView(
        17, 18, 5, 5, 15, 26.0, (-.7660, -.3214, -.5567, 0, .8660, -.5, .6428, -.3830, -.6634), (0, -80, 250),
        (-.7611, -.3301, -.5583, .0041, .8584, -.5130, .6486, -.3928, -.6520), (.11, -80.62, 253.24)),
    'l_shape_v1': ThesisView(
        15, 18, 5, 5, 5, 14.5, (.7660, -.3214, -.5567, 0, .8660, -.5, .6428, .3830, .6634), (10, -30, 150),
        (.7665, -.3187, -.5576, .0036, .8704, -.4924, .6422, .3754, .6683), (9.72, -30.45, 150.84)),
    'l_shape_v2': ThesisView(
        9, 9, 5, 5, 5, 11.9, (.7660, 0, -.6428, 0, -1, 0, -.6428, 0, -.7660), (-30, 30, 120),
        (.7631, -.0003, -.6463, .0012, -1, .0019, -.6463, -.0023, -.7631), None),
    'wedge_v1': ThesisView(
        12, 12, 5, 5, 5, 25.5, (.6428, .3830, .6634, 0, .8660, -.5, -.7660, .3214, .5567), (-30, 20, 250),
        (.6441, .3848, .6611, -.0016, .8649, -.5019, -.7649, .3222, .5577), (-29.78, 20.17, 251.33)),
    'wedge_v2': ThesisView(
        8, 8, 10, 10, 15, 11.0, (.8660, 0, -.5, 0, -1, 0, -.5, 0, -.8660), (-30, 30, 200),
        (.8643, .0002, -.5030, .0066, -.9999, .0109, -.5030, -.0127, -.8642), None),
    'plug_v1': ThesisView(
        40, None, None, None, None, 21.7, (.5, -.4967, -.7094, .8660, .2868, .4096, 0, -.8192, .5736), (-25, -40, 110),
        (.5053, -.4949, -.7069, .8630, .2859, .4166, -.0041, -.8206, .5715), (-24.79, -39.91, 111.03)),
    'plug_v2': ThesisView(
        13, 13, None, None, None, 18.4, (-.6428, -.2620, -.7198, 0, .9397, -.3420, .7660, -.2198, -.6040),
        (-30, -40, 120), (-.6556, -.2588, -.7093, -.0020, .9400, -.3411, .7551, -.2222, -.6168),
        (-30.41, -39.48, 121.43)),
    'cylinder_box_v1': ThesisView(
        12, 12, 3, 3, 10, None, (.7660, -.4132, -.4924, 0, .7660, -.6428, .6428, .4924, .5868), (30, -20, 180),
        (.7637, -.4154, -.4942, -.007, .7650, -.6441, .6456, .4922, .5839), (30.30, -20.01, 181.17)),
    'cylinder_box_v2': ThesisView(
        12, 12, 3, 3, 10, None, (-.8660, -.25, .4330, 0, .8660, .5, -.5, .4330, -.75), (-50, -20, 150),
        (-.8624, -.2502, .4401, .0055, .8646, .5024, -.5063, .4357, -.7442), (-50.44, -19.86, 151.87)),
    'lamp_v1': ThesisView(
        20, 20, 3, 3, 10, None, (.7660, -.3214, -.5567, 0, .8660, -.5, .6428, .3830, .6634), (-30, -50, 200),
        (.7732, -.3208, -.5470, .0058, .8662, -.4998, .6341, .3832, .6716), (-30.46, -50.01, 201.49)),
    'lamp_v2': ThesisView(
        18, 18, 3, 3, 10, None, (.7660, .4132, -.4924, 0, .7660, .6428, .6428, -.4924, .5868), (-10, -50, 130),
        (.7676, .4071, -.4951, -.0012, .7733, .6340, .6410, -.4861, .5940), (-9.95, -50.16, 131.76)),
    'tubes_v1': ThesisView(
        11, 11, 5, 5, 15, None, (.7071, -.3536, -.6124, 0, .8660, -.5, .7071, .3536, .6124), (-30, -50, 250),
        (.7068, -.3343, -.6234, -.0161, .8734, -.4867, .7072, .3540, .6120), None),
}

# Tables 5.1, 5.3, 6.1 and the texts of 5.11.5 and 6.9.1: primitives, half-spaces, faces (planar ones for the last
# three), edges, curves, axes; None where not printed.
MODELS: dict[str, tuple[int | None, int | None, int | None, int, int, int]] = {
    'chipped_block': (2, 12, 7, 15, 0, 0), 'chair': (3, 18, 12, 30, 0, 0), 'computer': (9, 54, 14, 32, 0, 0),
    'l_shape': (2, 12, 8, 18, 0, 0), 'wedge': (3, 18, 7, 15, 0, 0), 'plug': (8, 48, None, 54, 0, 0),
    'cylinder_box': (None, None, 7, 12, 2, 1), 'lamp': (None, None, 13, 24, 3, 1), 'tubes': (None, None, 10, 0, 10, 5),
    'widget': (None, None, None, 28, 3, 1),
}

# Tables 4.3 and 4.4: primitives, half-spaces, tiles of 256 rendered.
TILING = {'coverplate': (25, 93, 95), 'recursive_cubes': (42, 147, 93), 'oil_rig': (44, 264, 90),
          'robot_arm': (63, 258, 50), 'geneva_wheel': (38, 147, 77)}
# 4.13.3: brute force / tiling on the DAP: mean, least (Coverplate), most (Robot Arm).
TILING_SPEEDUP = {'mean': 18.1, 'coverplate': 8.7, 'robot_arm': 31.6}
# 4.13.3: intersections saved by tiling: more than 90 % everywhere, Robot Arm 98.1 %; nodes: more than 90 %; combines:
# mean 68.6 %, Geneva Wheel 80.4 %; a tile's tree is 12.5 % of the scene's on average.
TILING_SAVED = {'intersections_least': 90.0, 'robot_arm_intersections': 98.1, 'nodes_least': 90.0,
                'combines_mean': 68.6, 'geneva_wheel_combines': 80.4, 'tile_tree_percent': 12.5,
                'preparation_percent': 5.5}

# Table 5.4: data edges, pairs, potential matches, matches under one constraint alone.
CONSTRAINT_ALONE = {
    'computer_v1': (26, 325, 332800, dict(distance=73032, angle=181276, direction1=139694, direction2=166804,
                                          direction3=131026)),
    'l_shape_v1': (18, 153, 49572, dict(distance=20870, angle=27864, direction1=24148, direction2=25366,
                                        direction3=13600)),
}
# Table 5.5: matches under all, and with one switched off.
CONSTRAINT_OFF = {
    'computer_v1': (21069, dict(distance=56709, angle=27630, direction1=26685, direction2=23842, direction3=25732)),
    'l_shape_v1': (5846, dict(distance=8432, angle=7876, direction1=6794, direction2=6344, direction3=8184)),
}

# 5.11.2: time of Holder and Buxton's sort over the Combined one; 'worst' did not end in 36 000 s (L-shape: 1 360 s).
SORT_SPEEDUP = {'chair_v1': 4.25, 'computer_v1': 1.0, 'l_shape_v1': 1.59}
SORT_EFFORT = {'chair_v1': 5.3, 'l_shape_v1': 1.5}  # levels, Holder and Buxton over Combined
SORT_TOP_TEN = {'chair_v1': 12.5, 'l_shape_v1': 8.6, 'computer_v1': 44.6 / 2.0}  # mean matches, Combined over H & B
# 5.11.3.2: serial time over Combined: mean, most and least.
SERIAL_OVER_COMBINED = {'mean': 5.7, 'wedge_v2': 12.8, 'l_shape_v1': 3.4}
# Figure 5.19's text: shares of the matching time.
PROFILE = {'tables': 26.4, 'traverse': 66.6}
# Table 5.7: rise in data pairs and in traversal speed between a model's two views, %, and which view has more pairs.
TRAVERSAL = {'chipped_block': (45.5, 10.4), 'chair': (9.5, 47.1), 'computer': (58.2, 65.1), 'l_shape': (65.7, 39.0),
             'wedge': (57.6, 57.8)}
# Table 5.11: seconds for ideal and recovered data.
PLUG = {('plug_v1', 'tree'): (1.80, 15.24), ('plug_v1', 'subgraph'): (4.54, 31.48),
        ('plug_v2', 'tree'): (0.28, 0.28), ('plug_v2', 'subgraph'): (0.61, 0.63)}
PLUG_V2_INTERPRETATIONS = 2
# 5.11.4.2: validation: rotation's share of the time, the Jacobi process' share of that; Computer v1 over Chipped Block
# v2 in parallel and serially.
VALIDATION = {'rotation_percent': 69.3, 'setup_percent': 3.3, 'jacobi_percent': 78.4, 'parallel_ratio': 1.13,
              'serial_ratio': 3.5}
# Table 6.7: error of the widgets' poses as the text gives them.
WIDGET = {'widget1': (0.6, (0.57, 0.39, 2.01)), 'widget2': (0.9, (1.45, 0.72, 0.50))}
# 6.8.2: mean errors over CylinderBox and Lamp.
CURVE_MEANS = {'translation_mm': (0.31, 0.31, 1.57), 'rotation_deg': 0.5, 'tubes_rotation_deg': 1.1}
