"""The arrays of frames: filled with background, used again when nobody holds them any more, or made from hits."""

from __future__ import annotations

import sys
from threading import Lock

import numpy as np

from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.typed import ByteArray, Float32Array, FloatArray, IntArray

from .frame import FACE_SLOTS, MISS, Frame, RenderStats
from .kernels.records import Target
from .programs.program import Program
from .settings import MOST_FRAME_BUFFERS
from .shading import quantise

# Bytes of a pixel of a frame: three ids, depth and normal take 4 bytes a number, the image 1 byte a channel.
WORD_BYTES = 7 * 4
PIXEL_BYTES = WORD_BYTES + 3


def new_frame(
    camera: PinholeCamera,
    camera_T_scene: Pose,
    background: FloatArray,
    with_radiance: bool = False,
    own_radiance: bool = False,
) -> tuple[Frame, Target]:
    """A frame that shows nothing but background, and its arrays; all but its radiance lie in one piece of memory.

    own_radiance : the target has room for radiance, not filled, that the frame does not show
    """
    h, w = camera.height, camera.width
    n = h * w
    hidden = 12 * n if own_radiance else 0
    memory = _memory(PIXEL_BYTES * n + 3 + hidden)
    # All bits set are -1 as an integer and NaN as a float: one fill at the speed of memory for ids, depth and normals.
    memory[: WORD_BYTES * n].fill(0xFF)
    words = memory[: WORD_BYTES * n].view(np.int32)
    ids = [words[k * n : (k + 1) * n].reshape(h, w) for k in range(3)]
    depth = words[3 * n : 4 * n].view(np.float32).reshape(h, w)
    normal = words[4 * n : 7 * n].view(np.float32).reshape(h, w, 3)
    image = memory[WORD_BYTES * n + hidden : PIXEL_BYTES * n + hidden].reshape(h, w, 3)
    image[0] = quantise(background)
    image[1:] = image[0]
    frame = Frame(image, depth, ids[0], ids[1], ids[2], normal, camera, camera_T_scene)
    radiance: Float32Array = np.empty((h, w, 3) if with_radiance else (0, 0, 3), dtype=np.float32)
    if with_radiance:
        radiance[:] = np.clip(background, 0.0, 1.0)
        frame.radiance = radiance
    elif own_radiance:
        radiance = memory[WORD_BYTES * n : WORD_BYTES * n + hidden].view(np.float32).reshape(h, w, 3)
    return frame, Target(image, depth, ids[0], ids[1], ids[2], normal, radiance)


class ImageHits:
    """The first hits of all pixels of an image, as the engines that are plain numpy fill them tile by tile."""

    def __init__(self, camera: PinholeCamera, background: FloatArray) -> None:
        h, w = camera.height, camera.width
        self.colours: FloatArray = np.empty((h, w, 3))
        self.colours[:] = background
        self.codes: IntArray = np.full((h, w), MISS, dtype=np.int64)
        self.depth: FloatArray = np.full((h, w), np.nan)
        self.normal: FloatArray = np.full((h, w, 3), np.nan)

    def frame(
        self,
        program: Program,
        camera: PinholeCamera,
        camera_T_scene: Pose,
        stats: RenderStats,
        with_radiance: bool = False,
    ) -> Frame:
        """The frame of these hits."""
        seen = self.codes != MISS
        leaf = np.where(seen, self.codes // FACE_SLOTS, 0)
        object_id = np.where(seen, program.object_of[leaf] if len(program.kind) else 0, MISS)
        return Frame(
            quantise(self.colours),
            self.depth.astype(np.float32),
            np.where(seen, leaf, MISS).astype(np.int32),
            np.where(seen, self.codes % FACE_SLOTS, MISS).astype(np.int32),
            object_id.astype(np.int32),
            self.normal.astype(np.float32),
            camera,
            camera_T_scene,
            stats,
            np.clip(self.colours, 0.0, 1.0).astype(np.float32) if with_radiance else None,
        )


# Memory of frames that may be handed out again. Fresh pages cost more than rendering into them does.
_memories: list[ByteArray] = []
_memories_lock = Lock()


def _references(memories: list[ByteArray]) -> list[int]:
    return [sys.getrefcount(memory) for memory in memories]


# How many references are counted for memory that only the list holds; it depends on the Python version.
_IDLE = _references([np.empty(0, dtype=np.uint8)])[0]


def _memory(size: int) -> ByteArray:
    """(size,) uint8, not initialised: memory of a frame nobody has any array of any more, else new memory."""
    with _memories_lock:
        for index, references in enumerate(_references(_memories)):
            # Every view of an array holds a reference to it.
            if references == _IDLE and _memories[index].size == size:
                return _memories[index]
        memory = np.empty(size, dtype=np.uint8)
        _memories.append(memory)
        del _memories[:-MOST_FRAME_BUFFERS]
        return memory
