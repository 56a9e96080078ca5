"""Answers as BOP's programs take them: one line of CSV for each pose, millimetres."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msgs_py import Pose

from .scene_folder import MM

COLUMNS = ('scene_id', 'im_id', 'obj_id', 'score', 'R', 't', 'time')


@dataclass(frozen=True, eq=False)
class BopResult:
    """One pose of one object in one image.

    Attributes
    ----------
    scene_id, image_id, object_id : int
    score : float
        The more, the surer; of any range.
    pose : Pose
        camera_T_model, or world_T_model where the scene's poses are in the world; metres.
    seconds : float
        For the whole image; -1 where it is not known.
    """

    scene_id: int
    image_id: int
    object_id: int
    score: float
    pose: Pose
    seconds: float = -1.0


def write_results(path: Path, results: Iterable[BopResult]) -> None:
    """Write a result file. Raises OSError."""
    with path.open('w', newline='', encoding='utf-8') as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for one in results:
            numbers = (_numbers(one.pose.rotation.ravel()), _numbers(one.pose.translation / MM))
            table.writerow(
                [one.scene_id, one.image_id, one.object_id, f'{one.score:.6g}', *numbers, f'{one.seconds:.4f}']
            )


def read_results(path: Path) -> list[BopResult]:
    """Read a result file. Raises OSError, or ValueError naming the line."""
    with path.open(newline='', encoding='utf-8') as file:
        rows = csv.DictReader(file)
        if tuple(rows.fieldnames or ()) != COLUMNS:
            raise ValueError(f'{path}: expected the columns {",".join(COLUMNS)}, got {rows.fieldnames}')
        found = []
        for row in rows:
            try:
                rotation = np.array(row['R'].split(), float).reshape(3, 3)
                u, _, v = np.linalg.svd(rotation)
                pose = Pose(u @ v, MM * np.array(row['t'].split(), float))
                numbers = (int(row['scene_id']), int(row['im_id']), int(row['obj_id']), float(row['score']))
                found.append(BopResult(*numbers, pose, float(row['time'])))
            except (AttributeError, TypeError, ValueError) as error:
                raise ValueError(f'{path}: line {rows.line_num}: {error}') from None
    return found


def _numbers(values: np.ndarray) -> str:
    return ' '.join(f'{value:.9g}' for value in values)
