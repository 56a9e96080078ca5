"""Stereo pairs of printed boxes on a table: drawn, with text, pictures and stripes on every face, worn corners, noise.

Boxes of all sizes; nothing in them is like any particular photograph but the print. Run as a command it counts how
often such a box is found, and how often another model is reported in its place.
"""

from __future__ import annotations

import argparse
import sys

import cv2
import numpy as np
from real_scoring import RealPair, score_box

from model_matcher import MatchParams, match
from model_matcher.closed_form.synthetic.scenes import box, chair, chipped_block, computer, l_shape, scaled, wedge
from model_matcher.verification.false_alarms import false_alarm_evidence
from msgs_py import FeatureSet, PinholeCamera, Pose, StereoRig
from stereo_recovery import recover

FINE = 3  # drawn so many times as large
PX_PER_M = 6000.0  # of the print
WORDS = ('INFUSION', 'Les Deux', 'crisp & dry', 'www.example.org', '250 g', 'No. 7', 'TEE', 'Original', 'Biscuits')
# Corners of a unit box, its twelve edges, and its faces.
CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
EDGES = np.array([(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(CORNERS[a] - CORNERS[b]).sum() == 1.0])
FACES = [(axis, side) for axis in range(3) for side in (0, 1)]


def _print(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """A printed face, grey levels."""
    image = np.full((height, width), int(rng.uniform(40, 220)), np.uint8)
    for _ in range(rng.integers(0, 4)):  # panels
        low = rng.uniform(-0.2, 0.8, 2) * [width, height]
        high = low + rng.uniform(0.2, 0.9, 2) * [width, height]
        cv2.rectangle(
            image, [int(x) for x in low], [int(x) for x in high], float(rng.uniform(20, 240)), -1, cv2.LINE_AA
        )
    for _ in range(rng.integers(0, 6)):  # blots: pictures, flowers
        centre, size = rng.uniform(0.1, 0.9, 2) * [width, height], rng.uniform(0.03, 0.2, 2) * min(width, height)
        cv2.ellipse(
            image,
            [int(x) for x in centre],
            [int(x) + 1 for x in size],
            float(rng.uniform(0, 180)),
            0,
            360,
            float(rng.uniform(20, 240)),
            -1,
            cv2.LINE_AA,
        )
    for _ in range(rng.integers(1, 6)):  # lines of text
        scale = rng.uniform(0.1, 0.25) * height / 22.0
        at = rng.uniform([0.0, 0.15], [0.6, 0.95]) * [width, height]
        cv2.putText(
            image,
            str(rng.choice(WORDS)),
            [int(x) for x in at],
            int(rng.choice([0, 2, 3, 4])),
            float(scale),
            float(rng.uniform(0, 255)),
            max(1, int(2.0 * scale)),
            cv2.LINE_AA,
        )
    return cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.5)


def _background(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """Wood: grain along the rows, seams."""
    grain = cv2.GaussianBlur(rng.normal(0.0, 1.0, (height, width)).astype(np.float32), (0, 0), 30.0, sigmaY=2.0)
    image = rng.uniform(90, 190) + rng.uniform(2.0, 10.0) * grain / max(float(grain.std()), 1e-6)
    for _ in range(rng.integers(0, 5)):
        y = int(rng.uniform(0, height))
        cv2.line(
            image,
            (0, y),
            (width, y + int(rng.normal(0, 0.03 * width))),
            float(rng.uniform(60, 120)),
            int(rng.integers(2, 6)),
            cv2.LINE_AA,
        )
    return image


def printed_box(seed: int) -> RealPair:
    """A pair of 640 x 480 images of a box of :func:`box_size`, and the box's edges in view (7 or 9, 2, 3), metres."""
    rng = np.random.default_rng([seed, 77])
    size = box_size(seed)
    distance = rng.uniform(2.2, 3.2) * np.linalg.norm(size)
    camera = PinholeCamera(640, 480, rng.uniform(600, 760), rng.uniform(600, 760), 319.5, 239.5)
    camera = PinholeCamera(640, 480, camera.fx, camera.fx, 319.5 + rng.normal(0, 4), 239.5 + rng.normal(0, 4))
    rig = StereoRig.symmetric(camera, rng.uniform(0.12, 0.22) * distance)
    tilt, turn, roll = np.radians([rng.uniform(25, 60), rng.uniform(-45, 45), rng.normal(0, 2)])
    rotation = (_about(2, roll) @ _about(0, -tilt) @ _about(1, turn)) @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
    middle = np.array([rng.uniform(0.3, 0.7) * rig.baseline, rng.normal(0.0, 0.03), 1.0]) * [1, distance, distance]
    pose = Pose(rotation, middle - rotation @ (0.5 * size))
    faces = [
        (axis, side, _print(rng, *np.maximum(16, (PX_PER_M * np.delete(size, axis)).astype(int))))
        for axis, side in FACES
    ]
    light = {axis: rng.uniform(0.45, 1.1) for axis in range(6)}
    wood = _background(rng, 640 * FINE + 400, 480 * FINE)
    wear = rng.uniform(0.0, 0.01)
    images = []
    for eye in (0, 1):
        shift = np.array([eye * rig.baseline, 0.0, 0.0])
        disparity = camera.fx * rig.baseline / (1.15 * distance) * FINE
        image = wood[:, int(np.clip(eye * disparity, 0, 400)) :][:, : 640 * FINE].copy()
        for number, (axis, side, face) in enumerate(faces):
            normal = rotation[:, axis] * (1.0 if side else -1.0)
            others = [a for a in range(3) if a != axis]
            corners = np.zeros((4, 3))
            corners[:, axis] = side * size[axis]
            corners[[1, 2], others[0]] = size[others[0]]
            corners[[2, 3], others[1]] = size[others[1]]
            seen = pose.apply(corners)
            if normal @ (seen.mean(axis=0) - shift) >= 0.0:
                continue
            # What is worn shines at the rim.
            rim = max(1, int(wear * PX_PER_M * size.min()))
            worn = face * light[number]
            if wear > 0.003:
                cv2.rectangle(worn, (0, 0), (worn.shape[1] - 1, worn.shape[0] - 1), float(rng.uniform(150, 230)), rim)
            h, w = worn.shape
            source = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
            target = ((camera.project(seen - shift) + 0.5) * FINE - 0.5).astype(np.float32)
            how = cv2.getPerspectiveTransform(source, target)
            area = (640 * FINE, 480 * FINE)
            layer = cv2.warpPerspective(
                cv2.GaussianBlur(worn, (0, 0), 1.0), how, area, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            mask = np.zeros((480 * FINE, 640 * FINE), np.uint8)
            cv2.fillConvexPoly(mask, np.round(target * 16).astype(np.int32), 1, shift=4)
            image[mask > 0] = layer[mask > 0]
        image = cv2.resize(cv2.GaussianBlur(image, (0, 0), 0.6 * FINE), (640, 480), interpolation=cv2.INTER_AREA)
        image = image * rng.uniform(0.93, 1.07) + rng.normal(0.0, rng.uniform(0.5, 3.0), image.shape)
        image = np.clip(image, 0, 255).round().astype(np.uint8)
        images.append(cv2.imdecode(cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, 92])[1], 0))
    middles = {(axis, side): pose.apply(size * (0.5 + (side - 0.5) * np.eye(3)[axis])) for axis, side in FACES}
    facing = {(axis, side) for (axis, side), at in middles.items() if (2 * side - 1) * (rotation[:, axis] @ at) < 0.0}
    ends = pose.apply(CORNERS * size)
    edges = [
        ends[[a, b]] for a, b in EDGES if any(CORNERS[a][axis] == CORNERS[b][axis] == side for axis, side in facing)
    ]
    return RealPair(f'printed box {seed}', images[0], images[1], rig, pose, np.array(edges))


def box_size(seed: int) -> np.ndarray:
    """(3,) float64, metres."""
    return np.random.default_rng([seed, 78]).uniform(0.05, 0.2, 3)


def _about(axis: int, angle: float) -> np.ndarray:
    vector = np.zeros(3)
    vector[axis] = angle
    return Pose.from_rotation_vector(vector).rotation


def poses_of(pose: Pose, size: np.ndarray) -> list[Pose]:
    """Every pose of a block that its half turns make as true."""
    middle = 0.5 * np.asarray(size)
    halves = [np.diag(np.array(turn, float)) for turn in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
    return [pose.compose(Pose(half, middle - half @ middle)) for half in halves]


RATES = (1e-1, 1e-2, 1e-3)
DECOYS = ('other boxes', 'same but one size', 'other models')


def decoy(kind: str, size: np.ndarray, rng: np.random.Generator) -> FeatureSet:
    """A model that is not in a picture of a box of this size: a box of which at least one size differs by 10 %, the box
    with one size 8 to 25 % off, or one of the thesis' models, about as large."""
    if kind == 'other boxes':
        while True:
            other = np.sort(rng.uniform(0.04, 0.2, 3))
            if np.abs(other / np.sort(size) - 1.0).max() > 0.1:
                return block(other)
    if kind == 'same but one size':
        other = np.array(size, float)
        other[rng.integers(3)] *= rng.choice([rng.uniform(0.8, 0.92), rng.uniform(1.08, 1.25)])
        return block(other)
    made = (chipped_block, l_shape, wedge, chair, computer)[rng.integers(5)]()
    extent = np.linalg.norm(np.ptp(np.concatenate([made.start, made.end]), axis=0))
    return scaled(made, float(np.linalg.norm(size) / extent * rng.uniform(0.7, 1.2)))


def block(size: np.ndarray) -> FeatureSet:
    """The edges of a block, one corner at the origin."""
    return box(size, (0.0, 0.0, size[2]))


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description='Printed boxes found, and other models reported in their place, at several false_alarm_rates.'
    )
    parser.add_argument('--seeds', type=int, default=30, help='boxes')
    parser.add_argument('--first-seed', type=int, default=0)
    parser.add_argument('--decoys', type=int, default=8, help='other models of each kind, tried in each picture')
    chosen = parser.parse_args(arguments)
    margins: dict[str, list[float]] = {kind: [] for kind in ('the box itself', *DECOYS)}
    edges, right = [], 0
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
        rng = np.random.default_rng([seed, 79])
        pair, size = printed_box(seed), box_size(seed)
        features = recover(pair.left, pair.right, pair.rig).features
        edges.append(score_box(pair, features).edges / len(pair.edges))
        for kind, count in (('the box itself', 1), *((kind, chosen.decoys) for kind in DECOYS)):
            for _ in range(count):
                model = block(size) if kind == 'the box itself' else decoy(kind, size, rng)
                found = match(model, features, MatchParams(false_alarm_rate=RATES[-1]))
                margin = found.stats.get('evidence', -np.inf) - found.stats.get('evidence_needed', 0.0)
                first = next(iter((*found.interpretations, *found.rejected)), None)
                if kind == 'the box itself' and first is not None:
                    error = min(true.error_to(first.pose).rotation_deg for true in poses_of(pair.left_T_object, size))
                    right += error < 3.0
                    margin = margin if error < 3.0 else -np.inf
                margins[kind].append(margin if first is not None else -np.inf)
    print(f'{chosen.seeds} printed boxes: {100 * np.mean(edges):.0f} % of the edges in view, right pose {right}')
    for rate in RATES:
        need = false_alarm_evidence(1, rate) - false_alarm_evidence(1, RATES[-1])
        print(
            f'rate {rate:<6g} '
            + ', '.join(
                f'{kind} {100 * np.mean(np.array(values) >= need):.2f} % of {len(values)}'
                for kind, values in margins.items()
            )
        )
    return 0


if __name__ == '__main__':
    sys.exit(main())
