"""Interpretations to and from diagnostic_msgs/DiagnosticArray: one status for each hypothesis, best first.

Values are JSON text, so that a person reads them and a program parses them back exactly.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from itertools import chain, repeat
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from ..interpretation import Interpretation
from ..pose import Pose
from .errors import CodecError

# The message of a status whose interpretation is accepted.
ACCEPTED = 'accepted'
# Values that are read back; 'matched', 'score' and 'instance' are there for a person.
READ_BACK = ('residual_rms_m', 'assignment', 'sign', 'pose', 'covariance', 'symmetric_poses', 'proven', 'free_shift')
# As these, but reports written before there were any lack them.
ADDED = ('free_turn', 'note', 'evidence', 'support', 'chance', 'ambiguous_poses')


def report_from_interpretations(
    interpretations: Iterable[Interpretation], header: Header | None = None, instances: Iterable[str] = ()
) -> DiagnosticArray:
    """The report of interpretations.

    Parameters
    ----------
    interpretations : iterable of Interpretation
        Best first.
    header : std_msgs.msg.Header, optional
    instances : iterable of str
        Names of the objects that the first of them are, the same from frame to frame; for who reads the report.

    Returns
    -------
    diagnostic_msgs.msg.DiagnosticArray
        Each status has the model's name; level OK and message 'accepted', or level WARN and the reason of rejection.
    """
    report = DiagnosticArray()
    if header is not None:
        report.header = header
    for item, instance in zip(interpretations, chain(instances, repeat(None))):
        values = {
            'matched': item.matched,
            'score': item.matched / max(1, len(item.assignment)),
            'residual_rms_m': item.residual_rms,
            'assignment': item.assignment.tolist(),
            'sign': item.sign.tolist(),
            'pose': _pose_values(item.pose),
            'covariance': None if item.covariance is None else item.covariance.tolist(),
            'symmetric_poses': [_pose_values(pose) for pose in item.symmetric_poses],
            'proven': item.proven,
            'free_shift': None if item.free_shift is None else item.free_shift.tolist(),
            'free_turn': None if item.free_turn is None else item.free_turn.tolist(),
            'note': item.note,
            'evidence': _number(item.evidence),
            'support': _number(item.support),
            'chance': _number(item.chance),
            'ambiguous_poses': [_pose_values(pose) for pose in item.ambiguous_poses],
        }
        if instance is not None:
            values['instance'] = instance
        report.status.append(
            DiagnosticStatus(
                level=DiagnosticStatus.OK if item.accepted else DiagnosticStatus.WARN,
                name=item.model,
                message=ACCEPTED if item.accepted else str(item.rejected_reason),
                values=[KeyValue(key=key, value=json.dumps(value)) for key, value in values.items()],
            )
        )
    return report


def interpretations_from_report(report: DiagnosticArray) -> list[Interpretation]:
    """The interpretations of a report.

    Raises
    ------
    CodecError
        Names status and key, when one is missing or damaged.
    """
    result = []
    for index, status in enumerate(report.status):
        values = {item.key: item.value for item in status.values}
        try:
            decoded = {key: json.loads(values[key]) for key in READ_BACK}
            decoded |= {key: json.loads(values.get(key, 'null')) for key in ADDED}
            accepted = status.level == DiagnosticStatus.OK
            result.append(
                Interpretation(
                    model=status.name,
                    assignment=np.array(decoded['assignment'], np.int32),
                    sign=np.array(decoded['sign'], np.int8),
                    pose=_pose(decoded['pose']),
                    residual_rms=decoded['residual_rms_m'],
                    covariance=decoded['covariance'],
                    symmetric_poses=tuple(_pose(pose) for pose in decoded['symmetric_poses']),
                    proven=bool(decoded['proven']),
                    rejected_reason=None if accepted else status.message,
                    free_shift=decoded['free_shift'],
                    free_turn=decoded['free_turn'],
                    note=decoded['note'],
                    evidence=_or_nan(decoded['evidence']),
                    support=_or_nan(decoded['support']),
                    chance=_or_nan(decoded['chance']),
                    ambiguous_poses=tuple(_pose(pose) for pose in decoded['ambiguous_poses'] or ()),
                )
            )
        except KeyError as error:
            raise CodecError(f'report.status[{index}]: no value {error.args[0]!r}') from None
        except (TypeError, ValueError) as error:
            raise CodecError(f'report.status[{index}]: {error}') from None
    return result


def _number(value: float) -> float | None:
    """A number as JSON writes it; None where it is not known."""
    return float(value) if math.isfinite(value) else None


def _or_nan(value: float | None) -> float:
    """What :func:`_number` wrote."""
    return math.nan if value is None else float(value)


def _pose_values(pose: Pose) -> dict[str, Any]:
    """A pose as JSON writes it, without loss."""
    return {'rotation': pose.rotation.tolist(), 'translation': pose.translation.tolist(), 'scale': pose.scale}


def _pose(values: dict[str, Any]) -> Pose:
    """The pose that :func:`_pose_values` wrote."""
    return Pose(np.array(values['rotation']), np.array(values['translation']), values['scale'])
