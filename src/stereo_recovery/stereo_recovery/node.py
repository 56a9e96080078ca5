"""recovery_node: from rectified (or raw) images of two cameras or more to edges, curves and axes in space."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from msgs_py import FeatureKind, PinholeCamera, Pose, StereoRig
from msgs_py.camera import ImageWindow
from msgs_py.codecs import array_to_image, features_to_cloud, features_to_markers
from msgs_py.node_runtime.adapted import Adapted
from msgs_py.node_runtime.beside import CHANGED_GRACE_S, ENDING_S, LOOK_S, Beside
from msgs_py.node_runtime.camera_input import SIDES, CameraConfig, CameraImages, CameraTopics, cameras_parameter
from msgs_py.node_runtime.config import parameter
from msgs_py.node_runtime.runtime import GraphNode, run_node
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.typed import AnyArray

from .cameras.rectification import Rectifier, RigImages
from .cameras.rig_files import load_camera_rig
from .drawing import draw_features
from .matching.rig_error import AXES, RigError, mean_error
from .matching.settings import CALIBRATION_ROW_SIGMA
from .params import DETECTORS, LIMITS, RecoveryParams
from .pipeline import Recovery, compile_steps, recover
from .settings import RIG_PAIRS, RIG_PERIOD_S

DEFAULT = RecoveryParams()


@dataclass(frozen=True)
class RecoveryConfig(CameraConfig):
    """Parameters of recovery_node."""

    cameras: int = cameras_parameter(2)
    calibration: str = parameter(
        '',
        'File that says where three cameras and more stand; empty: parallel ones, as P of their camera_info says',
        read_only=True,
    )
    rectify: bool = parameter(False, 'The images are raw: undistort and rectify them with CameraInfo')
    detector: str = parameter(DEFAULT.detector, 'Edge detector', choices=DETECTORS)
    sigma: float = parameter(
        DEFAULT.sigma,
        'Gaussian smoothing of the images',
        unit='px',
        minimum=LIMITS['sigma'][0],
        maximum=LIMITS['sigma'][1],
    )
    low: float = parameter(
        DEFAULT.low,
        'Lower threshold of hysteresis, after smoothing; raised where the image is noisy',
        unit='grey levels/px',
        minimum=LIMITS['low'][0],
        maximum=LIMITS['low'][1],
    )
    high: float = parameter(
        DEFAULT.high,
        'Upper threshold of hysteresis, after smoothing; raised where the image is noisy',
        unit='grey levels/px',
        minimum=LIMITS['high'][0],
        maximum=LIMITS['high'][1],
    )
    min_length: float = parameter(
        DEFAULT.min_length,
        'Shortest straight edge',
        unit='px',
        minimum=LIMITS['min_length'][0],
        maximum=LIMITS['min_length'][1],
    )
    min_disparity: float = parameter(
        DEFAULT.min_disparity,
        'Least disparity of a match',
        unit='px',
        minimum=LIMITS['min_disparity'][0],
        maximum=LIMITS['min_disparity'][1],
    )
    max_disparity: float = parameter(
        0.0,
        'Largest disparity of a match; 0: nearly the width of the image',
        unit='px',
        minimum=0.0,
        maximum=LIMITS['min_disparity'][1],
    )
    support_radius: float = parameter(
        DEFAULT.support_radius,
        'Neighbourhood in which matches support each other',
        unit='px',
        minimum=LIMITS['support_radius'][0],
        maximum=LIMITS['support_radius'][1],
    )
    min_belief: float = parameter(
        DEFAULT.min_belief,
        'Probability below which a pair of segments is no match',
        minimum=LIMITS['min_belief'][0],
        maximum=LIMITS['min_belief'][1],
    )
    rectification_sigma: float = parameter(
        DEFAULT.rectification_sigma,
        'Least sigma of single rows; what the pair itself shows of their error is measured',
        unit='px',
        minimum=LIMITS['rectification_sigma'][0],
        maximum=LIMITS['rectification_sigma'][1],
    )
    calibration_sigma: float = parameter(
        CALIBRATION_ROW_SIGMA,
        'What the calibration of a pair left its rows off by; a rig that is farther off is reported to have drifted',
        unit='px',
        minimum=0.0,
        maximum=10.0,
    )
    time_limit: float = parameter(
        0.0,
        'Time for one pair; what would begin too late is left out, and diagnostics say what; 0: no limit',
        unit='s',
        minimum=0.0,
        maximum=LIMITS['time_limit'][1],
    )
    sync_queue_size: int = parameter(
        5, 'Pairs that may wait for their other half', name='sync.queue_size', minimum=1, maximum=100, read_only=True
    )
    sync_tolerance: float = parameter(
        0.0,
        'Largest difference of stamps in a pair',
        name='sync.tolerance',
        unit='s',
        minimum=0.0,
        maximum=1.0,
        read_only=True,
    )

    def validate(self) -> None:
        """Raises ValueError, naming the parameter, for values that the library refuses."""
        self.params()
        CameraTopics.of(self, self.cameras)
        if self.calibration and self.cameras == 2:
            raise ValueError(
                'parameter calibration: of two cameras camera_info says all; expected cameras to be 3 or more'
            )

    def params(self) -> RecoveryParams:
        """The same as the library takes them; raises ValueError for what it refuses."""
        return RecoveryParams(
            self.detector,
            self.sigma,
            self.low,
            self.high,
            self.min_length,
            self.min_disparity,
            self.max_disparity or None,
            self.support_radius,
            self.min_belief,
            self.rectification_sigma,
            self.time_limit or None,
        )


class RecoveryNode(GraphNode[RecoveryConfig]):
    """Publishes ``features``, and on demand ``features/markers`` and ``debug_image``."""

    brief = True

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('recovery_node', RecoveryConfig, **kwargs)
        self._calibration: tuple[object, ...] = ()
        self._rectifier: Rectifier | None = None
        self._images: RigImages | None = None
        self._reason = ''
        self._counts: dict[str, object] = {}
        self._rig_errors: deque[RigError] = deque(maxlen=RIG_PAIRS)
        source = CameraTopics.of(self.config, self.config.cameras).source
        self._work = Beside(self, source, self._begin, self._publish)
        self._rig_looked_at = 0.0
        self.start()

    def configure(self) -> None:
        """Make the outputs, and compile."""
        self.features_out = self.create_output(PointCloud2, 'features')
        self.markers_out = self.create_output(MarkerArray, 'features/markers')
        self.debug_out = self.create_output(Image, 'debug_image')
        self.prepare(compile_steps())

    def unusable(self) -> str:
        """A calibration file that cannot be read. See ManagedNode."""
        try:
            self._poses()
        except ValueError as error:
            return str(error)
        return super().unusable()

    def activate(self) -> None:
        """Subscribe to the images."""
        queue = self.config.sync_queue_size, self.config.sync_tolerance
        self.listen_images(CameraTopics.of(self.config, self.config.cameras), self.on_images, *queue)
        self.every(LOOK_S, self._work.look, clock=self._steady_clock)

    def on_images(self, images: CameraImages) -> None:
        """One image of each camera. Everything published carries the first one's header."""
        self._work.take(images)

    def _begin(self, images: CameraImages, deadline: Deadline) -> Callable[[], Recovered]:
        """Recovery by the parameters of now."""
        params = self.config.params()
        if len(images.infos) > 2:
            return partial(_of_many, images, self._images_for(images.infos), params, deadline)
        rectifier = self._rectifier_for(images.infos) if self.config.rectify else None
        return partial(_of_pair, images, rectifier, params, deadline)

    def _publish(self, images: CameraImages, recovered: Recovered) -> None:
        """Publish what was found."""
        result, picture, camera = recovered
        header = images.header
        self.give(self.features_out, Adapted(result.features, header, features_to_cloud))
        self._reason = result.reason
        kinds = {f'features.{kind.name.lower()}s': int((result.features.kind == kind).sum()) for kind in FeatureKind}
        self._counts = {
            **kinds,
            **result.counts,
            **{f'milliseconds.{name}': f'{value:.1f}' for name, value in result.milliseconds.items()},
            'left_out': '; '.join(result.left_out),
        }
        if self.wanted(self.markers_out):
            self.markers_out.publish(features_to_markers(result.features, header))
        if self.wanted(self.debug_out):
            self.debug_out.publish(array_to_image(draw_features(picture, result.features, camera), 'rgb8', header))
        if result.reason:
            self.problem(f'no features: {result.reason}')
        self.done(header)
        self._look_at_rig(result)

    def _look_at_rig(self, result: Recovery) -> None:
        """Keep what a pair now and then says of the rig; what others said of another calibration is forgotten."""
        if result.rows is None or self.config.cameras > 2:
            return
        if self._rig_errors and self._rig_errors[-1].rig != result.rows.rig:
            self._rig_errors.clear()
        now = time.monotonic()
        due = not self._rig_errors or now - self._rig_looked_at >= RIG_PERIOD_S
        if due and result.rig_error is not None:
            self._rig_errors.append(result.rig_error)
            self._rig_looked_at = now

    def _rig_error(self) -> RigError | None:
        """What the last pairs say of the rig; nothing of three cameras and more, whose main pair may change."""
        return mean_error(self._rig_errors) if self._rig_errors else None

    def doubt(self) -> str | None:
        """That the rig has drifted."""
        error = self._rig_error()
        if error is None or not error.tells or not error.has_drifted(self.config.calibration_sigma):
            return None
        return error.verdict(self.config.calibration_sigma)

    def _rectifier_for(self, infos: Sequence[CameraInfo]) -> Rectifier:
        """The rectification maps for this calibration, made again only when it has changed."""
        key = _calibration_of(infos)
        if self._rectifier is None or key != self._calibration:
            self._rectifier, self._calibration = Rectifier(*infos), key
        return self._rectifier

    def _images_for(self, infos: Sequence[CameraInfo]) -> RigImages:
        """The same of three cameras and more, and where these stand."""
        key = _calibration_of(infos)
        if self._images is None or key != self._calibration:
            self._images = RigImages(infos, self._poses(), self.config.rectify)
            self._calibration = key
        return self._images

    def _poses(self) -> Sequence[Pose] | None:
        """Where the calibration file says that the cameras stand; None without one."""
        if not self.config.calibration:
            return None
        try:
            # Poses need no sizes of images.
            rig = load_camera_rig(self.config.calibration, (1, 1))
        except (OSError, ValueError) as error:
            raise ValueError(f'parameter calibration: {error}') from None
        if len(rig) != self.config.cameras:
            raise ValueError(
                f'parameter calibration: {self.config.calibration}: has {len(rig)} cameras, expected '
                f'{self.config.cameras}, as the parameter cameras says'
            )
        return rig.poses

    def on_config(self, old: RecoveryConfig, new: RecoveryConfig) -> None:
        """What is recovered by other parameters has a moment left, and is begun anew then. See GraphNode."""
        if new.params() != old.params() or new.rectify != old.rectify:
            self._work.begin_anew(CHANGED_GRACE_S)

    def deactivate(self) -> None:
        """End what is under way."""
        self._work.drop()

    def destroy_node(self) -> None:
        """As GraphNode's; what is under way is ended."""
        work = getattr(self, '_work', None)  # there is none when the node could not be made
        if work is not None:
            work.close(ENDING_S)
        super().destroy_node()

    def cleanup(self) -> None:
        """Forget maps and counters."""
        self.reset()

    def reset(self) -> str:
        """Forget maps and counters; returns what was forgotten."""
        self._work.drop()
        self._rectifier, self._images, self._reason, self._counts = None, None, '', {}
        self._rig_errors.clear()
        return 'rectification maps and counters'

    def report_values(self) -> dict[str, object]:
        """Counts, times and the reason of an empty result, for /diagnostics."""
        return {**self._counts, **self._rig_values(), 'reason': self._reason}

    def _rig_values(self) -> dict[str, object]:
        """How far the rig has drifted, as numbers."""
        error = self._rig_error()
        if error is None:
            return {}
        turns = {f'rig.{name}_deg': f'{turn:.4f}' for name, turn in zip(AXES, np.degrees(error.rotation))}
        sigmas = {f'rig.{name}_sigma_deg': f'{sigma:.4f}' for name, sigma in zip(AXES, np.degrees(error.sigma))}
        return {
            **turns,
            **sigmas,
            'rig.rows_middle_px': f'{error.offset_px:.3f}',
            'rig.rows_most_px': f'{error.most_px:.3f}',
            'rig.row_sigma_px': f'{error.row_sigma:.3f}',
            'rig.distance': f'{error.distance(self.config.calibration_sigma):.2f}',
            'rig.drifted': error.has_drifted(self.config.calibration_sigma) if error.tells else 'unknown',
        }


class Recovered(NamedTuple):
    """What was found, the picture of the left or first camera, and that camera."""

    result: Recovery
    picture: AnyArray
    camera: PinholeCamera


def _of_pair(
    images: CameraImages, rectifier: Rectifier | None, params: RecoveryParams, deadline: Deadline
) -> Recovered:
    """Of a pair, with a rectifier where it is raw."""
    left, right = images.pictures()
    if rectifier is not None:
        left, right = rectifier.apply(left, right)
        rig = rectifier.rig
    else:
        rig = StereoRig.from_camera_info(*images.infos)
        for side, picture, info in zip(SIDES, (left, right), images.infos):
            _check_size(side, picture, info)
    return Recovered(recover(left, right, rig, params, deadline=deadline), left, rig.left)


def _of_many(images: CameraImages, rig_images: RigImages, params: RecoveryParams, deadline: Deadline) -> Recovered:
    """Of three cameras and more."""
    pictures = rig_images.apply(images.pictures())
    result = recover(pictures, rig_images.rig, params, deadline=deadline)
    return Recovered(result, pictures[0], rig_images.rig.cameras[0])


def _check_size(side: str, image: AnyArray, info: CameraInfo) -> None:
    """Refuse an image that is not of the pixels that its camera_info tells of, with what that says of them."""
    window = ImageWindow.of(side, info)
    if image.shape[:2] != (window.height, window.width):
        raise ValueError(
            f'{side} image: {image.shape[1]} x {image.shape[0]} pixels, expected the {window} of its camera_info'
        )


def _calibration_of(infos: Sequence[CameraInfo]) -> tuple[object, ...]:
    """What of camera_info decides how images are rectified."""
    return tuple(
        (
            *(info.width, info.height, info.binning_x, info.binning_y),
            *(info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height),
            *(info.distortion_model, tuple(info.d), tuple(info.k), tuple(info.r), tuple(info.p)),
        )
        for info in infos
    )


def main(args: list[str] | None = None) -> int:
    """Console script."""
    return run_node(RecoveryNode, args)
