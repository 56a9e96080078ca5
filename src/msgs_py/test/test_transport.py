"""Shared memory for images: named to the middleware, unless the user has arranged it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from msgs_py.node_runtime.transport import USER_FILES, USER_SETTINGS, make_room_for_images


def test_the_profile_is_named_and_holds_several_images(tmp_path):
    environment: dict[str, str] = {}
    assert make_room_for_images(environment, tmp_path)
    root = ElementTree.parse(Path(environment['FASTRTPS_DEFAULT_PROFILES_FILE'])).getroot()
    size = next(item for item in root.iter() if item.tag.endswith('segment_size'))
    assert int(size.text) >= 8 * 2 * 512 * 512


def test_the_profile_makes_processes_announce_themselves_often(tmp_path):
    environment: dict[str, str] = {}
    make_room_for_images(environment, tmp_path)
    root = ElementTree.parse(Path(environment['FASTRTPS_DEFAULT_PROFILES_FILE'])).getroot()
    period, lease = (
        {item.tag.rpartition('}')[2]: int(item.text) for item in duration}
        for name in ('leaseAnnouncement', 'leaseDuration')
        for duration in root.iter()
        if duration.tag.endswith(name)
    )
    seconds = period['sec'] + 1e-9 * period['nanosec']
    assert 0.1 <= seconds <= 1.0, 'a node started again waits for this at the most'
    assert lease['sec'] >= 10 * seconds, 'a few lost announcements are no death'


@pytest.mark.parametrize('setting', USER_SETTINGS)
def test_a_user_who_has_arranged_the_transport_is_left_alone(setting, tmp_path):
    environment = {setting: 'mine'}
    assert not make_room_for_images(environment, tmp_path)
    assert environment == {setting: 'mine'}


@pytest.mark.parametrize('name', USER_FILES)
def test_a_profile_file_in_the_working_folder_counts_too(name, tmp_path):
    (tmp_path / name).write_text('<dds/>')
    assert not make_room_for_images({}, tmp_path)
