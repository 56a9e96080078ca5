"""renderer_node: a scene file seen by a stereo camera, as the topics of a pair with its ground truth."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.timer import Timer
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from msgs_py.codecs import array_to_image, camera_infos_from_rig, features_to_cloud, pose_to_stamped
from msgs_py.node_runtime.background import Background
from msgs_py.node_runtime.confinement import TrustedFolders
from msgs_py.node_runtime.runtime import GraphNode, run_node
from msgs_py.node_runtime.until import Until
from msgs_py.numeric.steps import CompileStep

from .language import SceneError, SceneFile, read_scene
from .language.includes import models_folder
from .params import RendererConfig
from .raycast.render import scene_rig, viewing_hints
from .raycast.stop import RenderStopped, Stop
from .stereo_pictures import Rendered, Wanted, frames_of, rendered
from .visibility.hidden_lines import compile_steps as hidden_line_steps

# Pixels of the largest image: about a gigabyte for each frame. Anybody on the network can set the size.
MAX_PIXELS = 2**25
# Seconds that a rendering has left when parameters change: what is nearly done is not lost, and nobody waits.
CHANGED_GRACE_S = 0.25
# Seconds between two looks at whether a rendering is late.
LOOK_S = 0.05


@dataclass(eq=False)
class Picture:
    """A stereo pair that is rendered in a thread of its own.

    Attributes
    ----------
    config : RendererConfig
        When it began.
    header : Header
    number : int
        Of the pair.
    stop : Stop
    begun, deadline : float
        Seconds of a steady clock.
    late : str
        What is said when the deadline ends it.
    job : Background
        Messages of what is published.
    published : bool
    """

    config: RendererConfig
    header: Header
    number: int
    stop: Stop
    begun: float
    deadline: float
    late: str
    job: Background[Rendered] | None = None
    published: bool = False


class RendererNode(GraphNode[RendererConfig]):
    """Publishes left/ and right/ image_rect and camera_info, and on demand image_raw, depth and ground truth."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('renderer_node', RendererConfig, **kwargs)
        # Of a group of its own: one that waits for the compiler keeps no other callback waiting.
        self.create_service(Trigger, '~/render', self._on_render, callback_group=ReentrantCallbackGroup())
        self._file: SceneFile | None = None
        self._read_at: dict[str, int] = {}
        self._pair_index = 0
        self._timer: Timer | None = None
        self._picture: Picture | None = None
        self._trusted = TrustedFolders(
            [*self.config.scene_folders, models_folder()], [self.config.scene], 'scene_folders'
        )
        self.start()

    # -- its life ----------------------------------------------------------------------------------------------

    def configure(self) -> None:
        """Make the outputs, read the scene, and compile."""
        self._images = [self.create_output(Image, f'{side}/image_rect') for side in ('left', 'right')]
        self._raw = [self.create_output(Image, f'{side}/image_raw') for side in ('left', 'right')]
        self._infos = [self.create_output(CameraInfo, f'{side}/camera_info') for side in ('left', 'right')]
        self._depth = self.create_output(Image, 'left/depth')
        self._pose = self.create_output(PoseStamped, 'ground_truth/pose')
        self._features = self.create_output(PointCloud2, 'ground_truth/features')
        self._load(self.config.scene)
        self.prepare(self._compile_steps())

    def unusable(self) -> str:
        """A scene that cannot be read, or a parameter that was refused. See ManagedNode."""
        return super().unusable() or (self.health.last_error if self._file is None else '')

    def activate(self) -> None:
        """Render at the rate that the parameter says."""
        self._start_timer()
        self.every(LOOK_S, self._look_at_the_clock, clock=self._steady_clock)

    def deactivate(self) -> None:
        """End what is being rendered."""
        self._timer = None
        if self._picture is not None:
            self._picture.stop.set('the node was deactivated')

    def cleanup(self) -> None:
        """Forget the scene."""
        self._file, self._read_at, self._pair_index = None, {}, 0

    # -- configuration -----------------------------------------------------------------------------------------

    def check_config(self, new: RendererConfig) -> None:
        """Refuse a scene outside the trusted folders, and one that cannot be read. See GraphNode."""
        if new.scene != self.config.scene:
            try:
                self._trusted.check(new.scene)
            except ValueError as error:
                raise ValueError(f'parameter scene: {error}') from None
            _read(new.scene)

    def on_config(self, old: RendererConfig, new: RendererConfig) -> None:
        """Read the new scene, and keep the new rate; what is rendered as it was wanted before is soon stopped."""
        picture = self._picture
        if picture is not None and time.monotonic() + CHANGED_GRACE_S < picture.deadline:
            picture.deadline, picture.late = time.monotonic() + CHANGED_GRACE_S, 'the parameters have changed'
        if new.scene != old.scene:
            self._load(new.scene)
        if new.rate != old.rate:
            self._start_timer()

    def reset(self) -> str:
        """Read the scene again and start noise and turntable over; returns what was done."""
        if self._picture is not None:
            self._picture.stop.set('the node was reset')
        self._pair_index = 0
        self._load(self.config.scene)
        return 'scene read again, noise and turntable started over'

    def why_silent(self) -> str | None:
        """Why no images come out, for the diagnostics; None when they should."""
        if self._file is None:
            return f'no scene: {self.health.last_error}'
        if self.config.rate == 0.0:
            return None
        return None if any(self.wanted(output) for output in self._outputs) else 'nobody subscribes to the images'

    def report_values(self) -> dict[str, object]:
        """Scene and number of rendered pairs, for the diagnostics."""
        return {'scene': self.config.scene, 'pairs': self._pair_index}

    @property
    def _outputs(self) -> list[Any]:
        return [*self._images, *self._raw, *self._infos, self._depth, self._pose, self._features]

    def _load(self, name: str) -> None:
        """Read the scene; when that fails say so and keep the last good one."""
        try:
            file = _read(name)
        except ValueError as error:
            kept = '' if self._file is None else '; the last good scene is kept'
            self.problem(f'{error}{kept}')
            # A file that cannot be read is read again when it changes, not at every frame.
            self._read_at = {path: _changed_at(path) for path in self._read_at or [name]}
            return
        for warning in (*file.warnings, *viewing_hints(file.scene)):
            self.get_logger().warning(f'scene: {warning}')
        self._file = file
        self._read_at = {str(path): _changed_at(path) for path in file.files}

    def _compile_steps(self) -> tuple[CompileStep, ...]:
        """What the first frame and its features need, so that they do not come seconds late."""
        if self._file is None or self.config.engine != 'native':
            return hidden_line_steps()
        scene = self._file.scene
        small = scene_rig(scene, 32, 32, baseline=self.config.baseline)
        config = self.config
        casting = CompileStep('ray casting', lambda: frames_of(scene, small, scene.camera_T_scene, config))
        lenses = config.lenses()
        if lenses is None:
            return (casting, *hidden_line_steps())
        raw = CompileStep('raw pictures', lambda: frames_of(scene, small, scene.camera_T_scene, config, lenses=lenses))
        return (casting, raw, *hidden_line_steps())

    def _start_timer(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None
        if self.config.rate > 0.0 and self.active:
            self._timer = self.every(1.0 / self.config.rate, self._guard('render', self._on_timer))

    # -- rendering ---------------------------------------------------------------------------------------------

    def _on_timer(self) -> None:
        if not self.compiling and self._picture is None and any(self.wanted(output) for output in self._outputs):
            self._begin()

    async def _on_render(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.active:
            response.success, response.message = False, f'renderer_node is {self.lifecycle}'
            return response
        await self.prepared()
        await Until(lambda: self._picture is None)
        self._guard('render', self._begin)()
        picture = self._picture
        if picture is not None:
            await Until(lambda: self._picture is not picture)
        response.success = picture is not None and picture.published
        response.message = (
            f'pair {picture.number}' if picture is not None and picture.published else self.health.last_error
        )
        return response

    def _begin(self) -> None:
        """Render the next pair in a thread of its own, so that the node answers meanwhile."""
        config = self.config
        if config.watch and any(_changed_at(path) != at for path, at in self._read_at.items()):
            self._load(config.scene)
        if self._file is None:
            raise ValueError(f'no scene: {self.health.last_error}')
        scene = self._file.scene
        rig = scene_rig(scene, config.width, config.height, config.focal, config.baseline)
        if rig.left.width * rig.left.height > MAX_PIXELS:
            raise ValueError(
                f'parameters width, height: {rig.left.width} x {rig.left.height} pixels are too many, '
                f'expected at most {MAX_PIXELS}'
            )
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id=config.frame_id)
        now = time.monotonic()
        late = f'it took longer than the time_limit of {config.time_limit:g} s'
        picture = Picture(config, header, self._pair_index, Stop(), now, now + config.time_limit, late)
        raw = any(self.wanted(output) for output in self._raw)
        wanted = Wanted(
            not raw or any(self.wanted(output) for output in (*self._images, self._depth)),
            raw,
            self.wanted(self._pose),
            self.wanted(self._features),
        )
        self._picture = picture
        picture.job = Background(
            lambda: rendered(scene, rig, config, picture.number, wanted, picture.stop),
            lambda: self.inbox.put(self._on_rendered),
        )

    def _look_at_the_clock(self) -> None:
        """Stop what is late; take what is done, should its guard condition have been overheard."""
        picture = self._picture
        if picture is not None and time.monotonic() > picture.deadline:
            picture.stop.set(picture.late)
        self._on_rendered()

    def _on_rendered(self) -> None:
        picture = self._picture
        if picture is not None and picture.job is not None and picture.job.done:
            if self.active:
                self._guard('render', self._publish)(picture, picture.job)
            self._picture = None

    def _publish(self, picture: Picture, job: Background[Rendered]) -> None:
        """Publish a pair; raises what went wrong with it."""
        self._callback_start = picture.begun
        try:
            done = job.result()
        except RenderStopped as stopped:
            raise ValueError(f'stopped: {stopped}') from None
        config, header = picture.config, picture.header
        for problem in done.problems:
            self.problem(problem)
        for output, info in zip(self._infos, camera_infos_from_rig(done.rig, header, config.lenses() or (None, None))):
            output.publish(info)
        for outputs, images in ((self._images, done.rectified), (self._raw, done.raw)):
            for output, image in zip(outputs, images):
                output.publish(array_to_image(image, config.encoding, header))
        if done.depth is not None and self.wanted(self._depth):
            self._depth.publish(array_to_image(done.depth, '32FC1', header))
        if done.pose is not None:
            self._pose.publish(pose_to_stamped(done.pose, header))
        if done.features is not None:
            self._features.publish(features_to_cloud(done.features, header))
        self._pair_index = picture.number + 1
        picture.published = True
        self.done(header)

    def destroy_node(self) -> None:
        """As GraphNode's; what is being rendered is stopped."""
        picture = getattr(self, '_picture', None)
        if picture is not None:
            picture.stop.set('the node ends')
            if picture.job is not None:
                picture.job.wait(2.0)
        super().destroy_node()


def _read(name: str) -> SceneFile:
    """Raises ValueError that starts with "scene" and says where and what."""
    try:
        return read_scene(name)
    except (SceneError, OSError) as error:
        raise ValueError(f'scene: {error}') from None


def _changed_at(path: str | Path) -> int:
    """Modification time in nanoseconds, 0 while there is no such file (editors replace files when they save)."""
    try:
        return os.stat(path).st_mtime_ns
    except OSError:
        return 0


def main(args: list[str] | None = None) -> int:
    """Run renderer_node until it is interrupted; the exit status."""
    return run_node(RendererNode, args)
