"""Rendered frames to files: pictures, exact arrays, cameras."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from msgs_py.numeric.typed import ByteArray

from .frame import Frame
from .settings import DEPTH_GREY_RANGE, HUE_STEP, LEAST_DEPTH_RANGE, SIXTEEN_BITS


def save_image(path: Path, image: np.ndarray) -> Path:
    """Write a picture.

    Parameters
    ----------
    path : Path
        The suffix says the format.
    image : (h, w) or (h, w, 3) array of uint8 or uint16
        Grey or RGB; 16 bits in .png and .tif only.

    Raises
    ------
    OSError
        It cannot be written; the message names the file.
    """
    if image.dtype == np.uint16 and path.suffix.lower() not in SIXTEEN_BITS:
        raise OSError(f'{path}: pictures of more than 8 bits are {", ".join(SIXTEEN_BITS)}')
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = image if image.ndim == 2 else image[..., ::-1]
    try:
        written = cv2.imwrite(str(path), np.ascontiguousarray(pixels))
    except cv2.error as error:
        raise OSError(f'{path}: no such picture format ({error.err})') from None
    if not written:
        raise OSError(f'{path}: cannot be written')
    return path


def depth_picture(frame: Frame) -> np.ndarray:
    """Depth as grey, (h, w) uint8: the nearest point white, the farthest dark grey, background black."""
    depth = frame.depth
    out = np.zeros(depth.shape, dtype=np.uint8)
    seen = np.isfinite(depth)
    if seen.any():
        low, high = float(depth[seen].min()), float(depth[seen].max())
        out[seen] = np.rint(255.0 - DEPTH_GREY_RANGE * (depth[seen] - low) / max(high - low, LEAST_DEPTH_RANGE)).astype(
            np.uint8
        )
    return out


def normal_picture(frame: Frame) -> np.ndarray:
    """Normals as colours, (h, w, 3) uint8: x, y, z of the camera, -1..1, to red, green, blue; background black."""
    normals = np.nan_to_num(frame.camera_normal, nan=-1.0)
    picture: ByteArray = np.rint((normals + 1.0) * 127.5).astype(np.uint8)
    return picture


def id_picture(ids: np.ndarray) -> np.ndarray:
    """Ids as colours, (h, w, 3) uint8, the same one for an id every time; background (-1) black."""
    n = int(ids.max(initial=-1)) + 1
    hues = (np.arange(n) * HUE_STEP % 1.0 * 180.0).astype(np.uint8)
    values = np.where(np.arange(n) % 2, 255, 190).astype(np.uint8)
    hsv = np.stack([hues, np.full(n, 170, dtype=np.uint8), values], axis=-1)[None]
    colours = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0] if n else np.zeros((0, 3), dtype=np.uint8)
    picture: ByteArray = np.concatenate([colours, np.zeros((1, 3), dtype=np.uint8)]).astype(np.uint8)[ids]
    return picture


def save_arrays(path: Path, frame: Frame) -> Path:
    """Write everything a frame knows as a compressed .npz: image, depth (metres), ids, normals, K, [R|t], the lens."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lens: dict[str, Any] = {}
    if frame.lens is not None:
        lens = {'distortion_model': frame.lens.model, 'D': frame.lens.coefficients}
    np.savez_compressed(
        path,
        image=frame.image,
        depth=frame.depth,
        primitive_id=frame.primitive_id,
        face_id=frame.face_id,
        object_id=frame.object_id,
        normal=frame.normal,
        K=frame.camera.matrix,
        camera_T_scene=frame.camera_T_scene.matrix,
        **lens,
    )
    return path


def camera_record(frame: Frame, baseline: float | None = None) -> dict[str, object]:
    """The view as plain numbers: K and camera_T_scene as [R|t] (metres, optical frame: x right, y down, z forward).

    Of a raw picture also the lens; K is then that of the raw camera, and of the one that it is undistorted to.
    """
    camera = frame.camera
    record: dict[str, object] = {
        'width': camera.width,
        'height': camera.height,
        'K': camera.matrix.tolist(),
        'camera_T_scene': frame.camera_T_scene.matrix[:3].tolist(),
        'convention': 'p_camera = R p_scene + t, metres; x right, y down, z forward; integer pixel = pixel centre',
    }
    if frame.lens is not None:
        record['distortion_model'] = frame.lens.model
        record['D'] = list(frame.lens.coefficients)
    if baseline is not None:
        record['baseline'] = baseline
    return record


def save_camera(path: Path, record: dict[str, object]) -> Path:
    """Write the plain numbers of a view as JSON; returns the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record, indent=2) + '\n', encoding='utf-8')
    return path
