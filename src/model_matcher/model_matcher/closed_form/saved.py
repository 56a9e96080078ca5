"""Failing cases on disk: everything needed to look at one, and to run it again."""

from __future__ import annotations

import json
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import cv2

from msgs_py.files import read_json

from .camera_options import camera_config
from .case import Case, Limits, is_plain_name
from .result import CaseResult
from .scene_files import case_scene, copy_scene

CASE_FILE = 'case.json'


def save_case(folder: Path, result: CaseResult, document: dict[str, Any], limits: Limits) -> None:
    """Write case.json, the scene with all it includes, both images, the features and the result into folder."""
    folder.mkdir(parents=True, exist_ok=True)
    path = case_scene(result.case, result.rig, folder)
    scene = path.name if path.parent == folder else copy_scene(path, folder)
    values = asdict(result.case) | {'scene': scene, 'label': result.case.name}
    if path.parent == folder:
        # The written scene holds pose, clutter and camera already.
        values |= {'pose': None, 'clutter': 0, 'width': None, 'height': None, 'focal': None, 'baseline': None}
    record = {'case': values, 'limits': asdict(limits), 'verdict': document['verdict'], 'result': document}
    (folder / CASE_FILE).write_text(json.dumps(record, indent=2) + '\n', encoding='utf-8')
    cv2.imwrite(str(folder / 'left.png'), result.left)
    cv2.imwrite(str(folder / 'right.png'), result.right)
    result.data.save(folder / 'features.npz')


def load_case(folder: str | Path) -> tuple[Case, Limits]:
    """A saved case. Raises ValueError, naming the file and what is wrong with it; OSError when there is none."""
    path = Path(folder) / CASE_FILE
    try:
        record = read_json(path)
        values, limits = dict(record['case']), dict(record['limits'])
    except FileNotFoundError:
        raise FileNotFoundError(f'{path}: no such file; a saved case is a folder of failing/ of a sweep') from None
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f'{path}: not a saved case: {error}') from None
    for name, given, known in (('case', values, Case), ('limits', limits, Limits)):
        unknown = set(given) - {field.name for field in fields(known)}
        if unknown:
            raise ValueError(f'{path}: {name}: unknown field {sorted(unknown)[0]!r}')
    if 'scene' not in values:
        raise ValueError(f"{path}: case: no field 'scene'")
    try:
        values['pose'] = tuple(float(value) for value in values['pose']) if values.get('pose') else None
        values['camera'] = tuple(values.get('camera') or ())
        for name, value in (*values.items(), *limits.items()):
            _check_kind(name, value)
        case = Case(**values)
        camera_config(case)
        beside = Path(folder) / case.scene
        # What lies below the folder is the case's own scene, and every other name one of csg_renderer's.
        below = '\0' not in case.scene and beside.resolve().is_relative_to(Path(folder).resolve())
        if not below or not (is_plain_name(case.scene) or beside.exists()):
            raise ValueError(f'scene: expected a file below the folder, or the name of a model, got {case.scene!r}')
        return replace(case, scene=str(beside)) if beside.exists() else case, Limits(**limits)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{path}: {error}') from None


def _check_kind(name: str, value: Any) -> None:
    """Refuse a value of another type than its field has; JSON does not say what it should be."""
    texts, numbers = ('scene', 'label'), (int, float)
    good = (
        name == 'pose'
        or (name == 'camera' and all(isinstance(text, str) for text in value))
        or (value is None and name in ('width', 'height', 'focal', 'baseline', 'label'))
        or (isinstance(value, str) if name in texts else isinstance(value, numbers) and not isinstance(value, bool))
    )
    if not good:
        raise ValueError(f'{name}: expected {"a text" if name in texts else "a number"}, got {value!r}')
