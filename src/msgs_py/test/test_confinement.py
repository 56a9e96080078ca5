"""Only files in trusted folders are opened on request from outside."""

from __future__ import annotations

import pytest

from msgs_py.node_runtime.confinement import TrustedFolders


@pytest.fixture
def tree(tmp_path, monkeypatch):
    for name in ('models/deep', 'other', 'here'):
        (tmp_path / name).mkdir(parents=True)
    for name in ('models/a.csg', 'models/deep/b.csg', 'other/secret.csg', 'here/local.csg'):
        (tmp_path / name).write_text('')
    (tmp_path / 'models/link.csg').symlink_to(tmp_path / 'other/secret.csg')
    (tmp_path / 'models/loop').symlink_to(tmp_path / 'models/loop')
    monkeypatch.chdir(tmp_path / 'here')
    return tmp_path


@pytest.mark.parametrize(
    'inside', ['models', 'models/a.csg', 'models/deep/b.csg', 'models/not_yet.csg', 'models/deep/../a.csg']
)
def test_what_lies_in_a_trusted_folder_passes(tree, inside):
    TrustedFolders([tree / 'models'], [], 'model_folders').check(str(tree / inside))


@pytest.mark.parametrize(
    'outside', ['other/secret.csg', 'models/../other/secret.csg', 'models/link.csg', 'models2', '', 'other']
)
def test_what_leads_out_of_them_is_refused_with_the_remedy(tree, outside):
    with pytest.raises(ValueError, match='model_folders'):
        TrustedFolders([tree / 'models'], [], 'model_folders').check(str(tree / outside))


@pytest.mark.parametrize('given', ['/etc/passwd', '..', '.', '../other/secret.csg', 'local.csg', '~/x.csg', '/'])
def test_relative_paths_home_and_files_of_the_working_directory_count_as_paths(tree, given):
    with pytest.raises(ValueError, match='outside'):
        TrustedFolders([tree / 'models'], [], 'model_folders').check(given)


def test_names_of_things_that_come_with_a_package_pass(tree):
    for name in ('l_shape_v1', 'x' * 5000):  # whether there is one of that name, its package says
        TrustedFolders([], [], 'model_folders').check(name)


def test_what_a_node_is_started_with_is_trusted_with_its_folder(tree):
    trusted = TrustedFolders([], [tree / 'models/a.csg', tree / 'other', 'l_shape'], 'model_folders')
    assert trusted.folders == (tree / 'models', tree / 'other')
    trusted.check(str(tree / 'models/deep/b.csg'))
    trusted.check(str(tree / 'other/secret.csg'))


@pytest.mark.parametrize('given', ['/x\0y', '/' + 'x' * 5000])
def test_impossible_paths_are_refused_not_raised_through(tree, given):
    with pytest.raises(ValueError, match='.') as refused:
        TrustedFolders([tree / 'models'], [], 'model_folders').check(given)
    assert len(str(refused.value)) < 6000
