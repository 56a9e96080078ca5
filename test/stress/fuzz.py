"""Thousands of malformed messages, parameters and requests against live nodes; the answer is a table and an exit code.

    python test/stress/fuzz.py --messages 10000

Each malformed input must be explained (refused with a reason, or counted), take less than two seconds, and the next
good input must be processed. All nodes run in this process and talk over real topics.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header

sys.path.insert(0, str(Path(__file__).resolve().parent))
import damage
import services
from harness import HANG_S, Failed, Harness

import csg_renderer
from csg_renderer.node import RendererNode
from dap_emulator.node import EmulatorNode
from model_matcher.node import MatcherNode
from msgs_py import PinholeCamera, StereoRig, codecs
from stereo_recovery.node import RecoveryNode

GOOD_EVERY = 10
RIG = StereoRig.symmetric(PinholeCamera.centred(96, 80, 130.0), 0.05)


class TopicFuzzer:
    """Damaged messages on a node's inputs, and a good one between them every now and then."""

    def __init__(self, harness: Harness, types: dict[str, type], good, rng: np.random.Generator) -> None:
        self.harness, self.node, self.good, self.rng = harness, harness.node, good, rng
        self.outputs = harness.publishers(types)
        self.sent = dict.fromkeys(types, 0)
        self.moment = 1000
        self.outcomes: Counter[str] = Counter()
        self.slowest = (0.0, '')
        self.damaged = 0

    def run(self, count: int) -> None:
        while self.damaged < count:
            for _ in range(GOOD_EVERY):
                self.damage_one()
            self.send_good()

    def send(self, messages: dict[str, Any], raw: frozenset[str] = frozenset()) -> None:
        for topic, message in messages.items():
            self.outputs[topic].publish(damage.garbled(self.rng, message) if topic in raw else message)
            self.sent[topic] += 1

    def heard(self) -> int:
        return sum(self.node._received.values())

    def damage_one(self) -> None:
        self.moment += 1
        messages = self.good(self.moment)
        choices = damage.CLOUD if 'features' in messages else damage.STEREO
        raw: frozenset[str] = frozenset()
        names = []
        if self.rng.random() < 0.12:
            raw, names = frozenset([damage.one_of(self.rng, list(messages))]), ['garbled']
        else:
            for _ in range(1 + int(self.rng.random() < 0.2)):
                damager = damage.one_of(self.rng, choices)
                try:
                    damager(self.rng, messages.get('features', messages))
                except (KeyError, IndexError, ValueError):
                    continue  # the first damage has taken away what the second wanted
                names.append(damager.__name__)
        self.damaged += 1
        before, problems = self.counts(), self.node.health.problems
        heard, start = self.heard(), time.monotonic()
        self.send(messages, raw)
        # What is garbled never arrives and is counted when the next message does.
        expected = heard + len(messages) - len(raw)
        if self.harness.spin(lambda: self.heard() >= expected, HANG_S) is None:
            raise Failed(f'{names}: not heard within {HANG_S} s: {self.node._received}, sent {self.sent}')
        took = time.monotonic() - start
        if raw:  # some garbled bytes are a message after all
            self.harness.spin(lambda: False, 0.02)
        self.slowest = max(self.slowest, (took, '+'.join(names)))
        if took > HANG_S:
            raise Failed(f'{names}: took {took:.2f} s')
        self.outcomes[self.explain(before, problems, names)] += 1

    def counts(self) -> dict[str, int]:
        health, sync = self.node.health, self.node._sync
        counts = {'processed': health.processed, 'refused with a reason': health.dropped}
        if sync is not None:
            counts |= {'late': sync.counters.late, 'unmatched': sync.counters.unmatched}
        return counts

    def explain(self, before: dict[str, int], problems: int, names: list[str]) -> str:
        """What became of it. A refusal comes with words."""
        after = self.counts()
        if after['refused with a reason'] > before['refused with a reason']:
            if self.node.health.problems == problems or ': ' not in self.node.health.last_error:
                raise Failed(f'{names}: dropped without a reason')
            if 'Error: ' in self.node.health.last_error:
                raise Failed(f'{names}: not foreseen: {self.node.health.last_error}')
            return 'refused with a reason'
        changed = [what for what in after if after[what] > before[what]]
        if changed:
            return changed[0]
        return 'garbled, counted as lost' if 'garbled' in names else 'waiting for its other half'

    def send_good(self) -> None:
        self.moment += 1
        before, heard = self.node.health.processed, self.heard()
        messages = self.good(self.moment)
        self.send(messages)
        if (
            self.harness.spin(
                lambda: self.node.health.processed > before and self.heard() >= heard + len(messages), HANG_S
            )
            is None
        ):
            raise Failed(
                f'a good input was not processed after {self.damaged} damaged ones; last error: '
                f'{self.node.health.last_error}'
            )

    def check_books(self) -> None:
        """Nothing vanishes: every message was heard or is counted as lost, and every stereo message has its fate."""
        self.send_good()
        heard, lost = self.heard(), self.node.health.lost
        if sum(self.sent.values()) != heard + lost:
            raise Failed(f'sent {sum(self.sent.values())}, heard {heard}, counted as lost {lost}')
        sync = self.node._sync
        if sync is not None:
            c = sync.counters
            waiting = sum(len(messages) for _, messages in sync._pending)
            fates = 4 * c.sets - c.borrowed + c.unmatched + c.late + c.spare + waiting
            if heard != fates:
                raise Failed(f'heard {heard}, but matched, unmatched, late and waiting are {fates}')


def stereo_source(rng: np.random.Generator):
    """moment -> good messages of a pair of a bright box before a dark ground."""
    image = np.full((80, 96), 60, np.uint8)
    image[20:60, 30:70] = 180
    left = image + rng.integers(0, 3, image.shape, dtype=np.uint8)
    right = np.roll(image, -8, axis=1) + rng.integers(0, 3, image.shape, dtype=np.uint8)

    def good(moment: int) -> dict[str, Any]:
        header = Header(frame_id='cam_left_optical_frame')
        header.stamp.sec = moment
        infos = codecs.camera_infos_from_rig(RIG, header)
        messages = {
            'left/image_rect': codecs.array_to_image(left, 'mono8', header),
            'left/camera_info': infos[0],
            'right/image_rect': codecs.array_to_image(right, 'mono8', header),
            'right/camera_info': infos[1],
        }
        for message in messages.values():  # damaged one by one
            message.header = copy.deepcopy(header)
        return messages

    return good


def cloud_source():
    solid = csg_renderer.load_models(csg_renderer.scene_path('l_shape'))['l_shape']
    features = csg_renderer.model_features(solid)

    def good(moment: int) -> dict[str, Any]:
        header = Header(frame_id='cam_left_optical_frame')
        header.stamp.sec = moment
        return {'features': codecs.features_to_cloud(features, header)}

    return good


def run(messages: int, seed: int, domain: int) -> dict[str, dict[str, object]]:
    """Everything, in a fixed order. Raises Failed."""
    rng = np.random.default_rng(seed)
    report: dict[str, dict[str, object]] = {}
    image_types = {topic: CameraInfo if topic.endswith('info') else Image for topic in damage.TOPICS}
    targets = (
        ('recovery_node', RecoveryNode, {}, image_types, stereo_source(rng), 0.5),
        ('recovery_node, raw images', RecoveryNode, {'rectify': True}, image_types, stereo_source(rng), 0.1),
        ('matcher_node', MatcherNode, {'models': ['l_shape']}, {'features': PointCloud2}, cloud_source(), 0.4),
    )
    for name, node_class, parameters, types, good, share in targets:
        harness = Harness(node_class, parameters, domain)
        try:
            fuzzer = TopicFuzzer(harness, types, good, rng)
            fuzzer.send_good()
            fuzzer.run(round(share * messages))
            fuzzer.check_books()
            report[f'{name}: messages'] = {
                'damaged': fuzzer.damaged,
                **fuzzer.outcomes,
                'slowest_s': round(fuzzer.slowest[0], 3),
                'slowest_damage': fuzzer.slowest[1],
            }
            report[f'{name}: parameters'] = dict(services.fuzz_parameters(harness, rng, messages // 20))
            fuzzer.send_good()
        finally:
            harness.close()
    with tempfile.TemporaryDirectory() as folder:
        report |= fuzz_services(rng, messages // 20, domain, Path(folder) / 'scene.csg')
    return report


def fuzz_services(rng: np.random.Generator, count: int, domain: int, scene: Path) -> dict[str, dict[str, object]]:
    """Parameters and services of the nodes that are driven by requests."""
    report: dict[str, dict[str, object]] = {}
    scene.write_bytes(csg_renderer.scene_path('l_shape_v1').read_bytes())
    for name, node_class, parameters in (
        ('renderer_node', RendererNode, {'rate': 0.0, 'scene': str(scene)}),
        ('emulator_node', EmulatorNode, {}),
    ):
        harness = Harness(node_class, parameters, domain)
        try:
            report[f'{name}: parameters'] = dict(services.fuzz_parameters(harness, rng, count))
            report[f'{name}: parameter services'] = dict(services.fuzz_parameter_services(harness, rng, count))
            report[f'{name}: requests'] = dict(
                services.fuzz_renderer(harness, rng, count, scene)
                if name == 'renderer_node'
                else services.fuzz_emulator(harness, rng, count)
            )
        finally:
            harness.close()
    return report


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--messages', type=int, default=10000, help='malformed messages on topics (default 10000)')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--domain', type=int, default=101, help='DDS domain (tests use 1 to 100)')
    arguments = parser.parse_args()
    start = time.monotonic()
    try:
        report = run(arguments.messages, arguments.seed, arguments.domain)
    except Failed as error:
        print(f'FAILED: {error}')
        return 1
    for name, values in report.items():
        print(f'{name}: {json.dumps(values)}')
    print(f'every input explained, no hang over {HANG_S:g} s; {time.monotonic() - start:.0f} s')
    return 0


if __name__ == '__main__':
    sys.exit(main())
