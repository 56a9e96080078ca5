"""A followed object to look at: frames with its outline, a film of them, and a plot of how sure it was."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from msgs_py.numeric.typed import ByteArray

from ...drawing import GREEN, ORANGE, RED, draw_line
from .follow import FollowedFrame

_LETTERS = 0.5


def draw_followed(one: FollowedFrame, scale: float = 1.0) -> ByteArray:
    """(h, w, 3) uint8 BGR: the first view with the outline of the object; confirmed parts green, others orange."""
    picture = cv2.cvtColor(one.frame.images[0], cv2.COLOR_GRAY2BGR)
    if scale != 1.0:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    lost = one.pose is None
    if not lost and one.tracked is not None:
        presence = one.tracked.presence
        placed = presence.sight.placed
        rows = presence.sight.rows(0)
        at = scale * (placed.pixel[rows] + 0.5) - 0.5
        half = 0.5 * scale * presence.sight.spacing[rows, None] * placed.normal[rows][:, ::-1] * [1.0, -1.0]
        for line, found in zip(np.stack([at - half, at + half], axis=1), presence.found[rows]):
            draw_line(picture, line, GREEN if found == 1 else ORANGE)
    words = 'lost' if lost else f'{one.tracked.presence.support:.0%}' if one.tracked else ''
    words = f'{one.frame.stamp_s:7.2f} s  {words}{"  found" if one.found_anew else ""}'
    cv2.putText(picture, words, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, _LETTERS, RED if lost else GREEN, 1, cv2.LINE_AA)
    return np.asarray(picture, np.uint8)


def write_film(path: Path, pictures: Sequence[ByteArray], rate_hz: float) -> None:
    """A film of pictures of one size: .mp4 or .avi by OpenCV, or .png, animated, which every browser shows.

    Raises
    ------
    ValueError
        OpenCV here cannot write such a file.
    """
    if path.suffix.lower() == '.png':
        path.write_bytes(animated_png(pictures, rate_hz))
        return
    height, width = pictures[0].shape[:2]
    code = cv2.VideoWriter_fourcc(*('MJPG' if path.suffix.lower() == '.avi' else 'mp4v'))  # type: ignore[attr-defined]
    writer = cv2.VideoWriter(str(path), code, rate_hz, (width, height))
    if not writer.isOpened():
        raise ValueError(f'{path}: OpenCV here writes no such films; an animated .png always works')
    for picture in pictures:
        writer.write(picture)
    writer.release()


def animated_png(pictures: Sequence[ByteArray], rate_hz: float) -> bytes:
    """Pictures (h, w, 3) uint8 BGR as one animated PNG (PNG specification, third edition, section 11.3.6)."""
    out = [b'\x89PNG\r\n\x1a\n']
    number = 0
    height, width = pictures[0].shape[:2]
    for k, picture in enumerate(pictures):
        chunks = _chunks(cv2.imencode('.png', picture)[1].tobytes())
        if k == 0:
            out += [_chunk(b'IHDR', next(data for kind, data in chunks if kind == b'IHDR'))]
            out += [_chunk(b'acTL', struct.pack('>II', len(pictures), 0))]
        delay = struct.pack('>HH', round(1000.0 / rate_hz), 1000)
        out.append(_chunk(b'fcTL', struct.pack('>IIIII', number, width, height, 0, 0) + delay + b'\x00\x00'))
        number += 1
        for kind, data in chunks:
            if kind == b'IDAT':
                out.append(_chunk(b'IDAT', data) if k == 0 else _chunk(b'fdAT', struct.pack('>I', number) + data))
                number += k > 0
    return b''.join([*out, _chunk(b'IEND', b'')])


def _chunks(png: bytes) -> list[tuple[bytes, bytes]]:
    """Kinds and contents of the chunks of a PNG file."""
    found, at = [], 8
    while at < len(png):
        (length,) = struct.unpack('>I', png[at : at + 4])
        found.append((png[at + 4 : at + 8], png[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))


def plot_followed(path: Path, frames: Sequence[FollowedFrame]) -> None:
    """Support, sigmas and time of every frame, as a picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 7), layout='constrained')
    support, shift, spent = figure.subplots(3, 1, sharex=True)
    stamp = np.array([one.frame.stamp_s for one in frames])
    nothing = np.full((6, 6), np.nan)
    spread = np.array([one.tracked.covariance if one.tracked and one.pose else nothing for one in frames])
    sigma = np.sqrt(np.maximum(np.diagonal(spread, axis1=1, axis2=2), 0.0))
    support.plot(stamp, [one.tracked.presence.support if one.tracked and one.pose else np.nan for one in frames])
    support.set(ylabel='support', ylim=(0, 1.05))
    for label, values in (
        ('mm', 1e3 * np.linalg.norm(sigma[:, :3], axis=1)),
        ('deg', np.degrees(np.linalg.norm(sigma[:, 3:], axis=1))),
    ):
        shift.semilogy(stamp, values, label=label)
    shift.set(ylabel='standard deviation')
    shift.legend()
    spent.semilogy(stamp, [one.milliseconds for one in frames], '.')
    spent.set(ylabel='ms a frame', xlabel='s')
    for axes in (support, shift, spent):
        for one in frames:
            if one.found_anew:
                axes.axvline(one.frame.stamp_s, color='0.7', lw=0.8)
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
