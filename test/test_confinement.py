"""A parameter that anybody on the network can set opens no file outside of the folders trusted at the start."""

from __future__ import annotations

import shutil

import pytest
from rclpy.parameter import Parameter

import csg_renderer
from csg_renderer.node import RendererNode
from dap_emulator.node import EmulatorNode
from model_matcher.node import MatcherNode

SCENE = 'l_shape_v1'
PROGRAM = """      SUBROUTINE COPY(IMAGE, RESULT)
      INTEGER*2 IMAGE(*32,*32), RESULT(*32,*32)
      RESULT = IMAGE
      RETURN
      END
"""


@pytest.fixture
def folders(tmp_path):
    """Three folders, each with the same models, scenes and programs."""
    for name in ('started', 'trusted', 'other'):
        (tmp_path / name).mkdir()
        for file in ('l_shape', SCENE):
            shutil.copy(csg_renderer.scene_path(file), tmp_path / name)
        (tmp_path / name / 'copy.f').write_text(PROGRAM)
    return tmp_path


CASES = [
    (MatcherNode, 'models', 'model_folders', 'l_shape.csg', lambda path: [path], SCENE),
    (RendererNode, 'scene', 'scene_folders', f'{SCENE}.csg', lambda path: path, 'l_shape_v2'),
]


@pytest.mark.parametrize(('node_class', 'name', 'adds', 'file', 'wrap', 'packaged'), CASES)
def test_files_outside_the_trusted_folders_are_refused_with_the_remedy(
    graph, folders, node_class, name, adds, file, wrap, packaged
):
    node = graph.add(
        node_class, parameters={name: wrap(str(folders / 'started' / file)), adds: [str(folders / 'trusted')]}
    )

    def change(path: str):
        return node.set_parameters_atomically([Parameter(name, value=wrap(path))])

    assert change(str(folders / 'trusted' / file)).successful
    assert change(str(folders / 'started' / file)).successful
    assert change(packaged).successful
    before = node.config
    for path in (folders / 'other' / file, '/etc/passwd', folders / 'trusted' / '..' / 'other' / file):
        refused = change(str(path))
        assert not refused.successful and adds in refused.reason and f'parameter {name}' in refused.reason
    assert node.config == before
    opened = node.set_parameters_atomically([Parameter(adds, value=['/'])])
    assert not opened.successful, 'the list of folders itself cannot be changed'


def test_a_program_of_the_emulator_is_confined_too(graph, folders):
    node = graph.add(EmulatorNode, parameters={'program_folders': [str(folders / 'trusted')]})

    def change(path):
        return node.set_parameters_atomically([Parameter('image_program', value=str(path))])

    refused = change(folders / 'other' / 'copy.f')
    assert not refused.successful and 'program_folders' in refused.reason
    inside = change(folders / 'trusted' / 'copy.f')
    assert inside.successful or 'program_folders' not in inside.reason
