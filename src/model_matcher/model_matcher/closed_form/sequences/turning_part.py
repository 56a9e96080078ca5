"""The demonstration of tracking: a part that turns, followed for a hundred frames, as a film."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

from ..case import Case
from ..following.follow import PictureFrame, follow
from ..following.track_cli import load_solid, write_followed
from ..viewing.view_files import followed_moment, write_view
from .motion import Motion
from .sequence import rendered_sequence

CASE = Case('chipped_block_v1', width=480, height=360, focal=450.0, antialias=2)
MOTION = Motion('turn', frames=100, turn_deg_s=60.0, shift_m_s=0.05)
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>A followed part</title>
<body style="font-family: sans-serif; max-width: 60em; margin: 2em auto">
<h1>A part that turns, followed for {frames} frames</h1>
<p>{told}.{view}</p><p><img src="film.png" alt="film"></p><p><img src="plot.png" alt="support, sigmas and time"></p>
"""
VIEW_LINK = ' <a href="view.html">In space, to turn</a>'


def run_turning_part(out: Path, quiet: bool = False) -> str:
    """Render the sequence, follow the part, and write film.png, plot.png, poses and report.html.

    Parameters
    ----------
    out : Path
        Folder; made when missing.
    quiet : bool
        No progress bar.

    Returns
    -------
    str
        What to tell the user, one line.
    """
    sequence = rendered_sequence(CASE, MOTION)
    source = (PictureFrame(frame.stamp_s, frame.images, sequence.rig) for frame in sequence)
    model = load_solid(CASE.scene)
    steps = follow(model, source)
    frames = list(tqdm(steps, 'a turning part', len(sequence), unit='', disable=quiet, file=sys.stdout))
    write_followed(out, frames, 'film.png', 0.75)
    errors = [true.error_to(one.pose) for true, one in zip(sequence.poses, frames) if one.pose is not None]
    turn, shift = (np.median(values) for values in zip(*((e.rotation_deg, 1e3 * e.translation) for e in errors)))
    told = (
        f'a turning part: followed in {len(errors)} of {len(frames)} frames, median errors {turn:.3f} deg, '
        f'{shift:.3f} mm'
    )
    moments = [followed_moment(model.name, one) for one in frames]
    in_space = write_view(out, 'a turning part', {model.name: model.features}, moments)
    page = PAGE.format(frames=len(frames), told=told.capitalize(), view=VIEW_LINK if in_space else '')
    (out / 'report.html').write_text(page, encoding='utf-8')
    return f'{told}; open {out}/report.html'
