"""The dap command, pictures of planes, notebook output, and image programs."""

import threading

import cv2
import numpy as np
import pytest

from dap_emulator import Dap
from dap_emulator.dap_cli import main, value_of
from dap_emulator.fortran_plus import Stopped
from dap_emulator.machine.drawing import draw, grid_of
from dap_emulator.service.imaging import ImageProgram


def test_a_program_file_runs_and_its_cycles_are_printed(tmp_path, capsys):
    file = tmp_path / 'double.fpp'
    file.write_text('ENTRY SUBROUTINE DOUBLE(A, N)\nREAL A(,)\nINTEGER N\nA = A + A\nN = N + 1\nEND\n')
    np.save(tmp_path / 'a.npy', np.full((40, 40), 1.5))
    code = main(
        [
            str(file),
            '-a',
            f'a={tmp_path}/a.npy',
            '-a',
            'n=4',
            '--listing',
            '--trace',
            '2',
            '--save',
            str(tmp_path / 'out.npz'),
        ]
    )
    out = capsys.readouterr().out
    assert code == 0 and 'add REAL*4' in out and '2924' in out and 'A = A + A' in out and 'computed' in out
    saved = np.load(tmp_path / 'out.npz')
    assert (saved['A'] == 3).all() and saved['N'] == 5


def test_the_library_and_the_cost_model_are_printed(capsys):
    assert main(['--list']) == 0 and 'mandelbrot' in capsys.readouterr().out
    assert main(['--functions']) == 0 and 'MAXV' in capsys.readouterr().out
    assert main(['--costs', '--set', 'copy=3']) == 0
    out = capsys.readouterr().out
    assert 'override' in out and 'thesis 3.2.1' in out and 'not simulated' in out


@pytest.mark.parametrize('suffix', ['png', 'gif'])
def test_planes_are_drawn(tmp_path, suffix):
    target = tmp_path / f'life.{suffix}'
    assert main(['life', '-a', 'cells=random:33x20:logical:3', '-a', 'generations=4', '--show', str(target)]) == 0
    from PIL import Image

    picture = Image.open(target)
    assert min(picture.size) > 100 and getattr(picture, 'n_frames', 1) == (4 if suffix == 'gif' else 1)
    assert len(set(np.asarray(picture.convert('L')).ravel().tolist())) > 3


def test_one_plane_can_be_drawn_alone(tmp_path):
    target = tmp_path / 'cells.png'
    assert (
        main(
            ['life', '-a', 'cells=zeros:9x9:logical', '-a', 'generations=1', '--plane', 'CELLS', '--show', str(target)]
        )
        == 0
    )
    assert cv2.imread(str(target)) is not None


@pytest.mark.parametrize(
    ('arguments', 'code', 'text'),
    [
        ([], 2, 'name a program'),
        (['nothing'], 2, 'neither a file nor a library program'),
        (['life', '-a', 'cells'], 2, 'NAME=VALUE'),
        (['life', '-a', 'cells=random:axb'], 2, 'random:32x32'),
        (['life', '-a', 'colour=1'], 2, 'no such argument'),
        (['life', '-a', 'cells=random:0x3'], 2, 'at least 1'),
        (['life', '-a', 'cells=nothing.png'], 2, 'nothing.png: no such file'),
        (['life', '--set', 'speed=1'], 2, 'unknown constant'),
        (['life', '-a', 'cells=random:9x9:logical', '--memory', '3'], 1, 'out of store'),
        (['sorts'], 2, '2 entries'),
        (['life', '--show', 'x.bmp'], 2, '.png'),
        (['life', '--plane', 'ODD', '--show', 'x.png'], 2, 'ODD is no argument'),
    ],
)
def test_what_makes_no_sense_is_one_clear_line(capsys, arguments, code, text):
    assert main(arguments) == code
    error = capsys.readouterr().err
    assert text in error and 'Traceback' not in error


def test_a_runaway_program_ends_the_command(tmp_path, capsys):
    file = tmp_path / 'endless.fpp'
    file.write_text('10 N = N + 1\nGOTO 10\n')
    assert main([str(file), '--seconds', '0.05']) == 1
    assert 'run time limit' in capsys.readouterr().err


def test_the_command_ends_inside_an_operation_that_takes_too_long(tmp_path, capsys, monkeypatch):
    """An operation that does not come back stands for one that takes long: it never looks at a limit."""
    file = tmp_path / 'long.fpp'
    file.write_text('X = 1.0\n')
    ended = threading.Event()
    codes = []

    def end(code):
        codes.append(code)
        ended.set()

    def endless(*_, **__):
        assert ended.wait(20.0), 'nobody ends the command'
        raise Stopped('run time limit')

    monkeypatch.setattr('dap_emulator.dap_cli.os._exit', end)
    monkeypatch.setattr('dap_emulator.fortran_plus.program.Program.run', endless)
    assert main([str(file), '--seconds', '0.1']) == 1
    assert codes == [1] and 'run time limit of 0.1 s reached' in capsys.readouterr().err


def test_values():
    assert value_of('3') == 3 and value_of('-2.5') == -2.5 and value_of('true') is True and value_of('UID0') == 'UID0'
    assert value_of('1,2,3').tolist() == [1, 2, 3] and value_of('zeros:2x3').shape == (2, 3)


def test_values_of_files_and_made_ones(tmp_path):
    np.savez(tmp_path / 'some.npz', a=np.arange(3), b=np.ones(2))
    assert value_of(f'{tmp_path}/some.npz:a').tolist() == [0, 1, 2]
    with pytest.raises(ValueError, match=r'holds a, b; name one as .*some.npz:NAME'):
        value_of(f'{tmp_path}/some.npz')
    cv2.imwrite(str(tmp_path / 'grey.png'), np.full((2, 3), 200, np.uint8))
    assert value_of(f'{tmp_path}/grey.png').tolist() == [[200] * 3] * 2
    assert value_of('zeros:2x2:logical').dtype == bool and value_of('random:2x2:integer').dtype == np.int16
    assert np.array_equal(value_of('random:4:real:7'), value_of('random:4:real:7'))


def test_a_long_vector_is_drawn_down_the_columns():
    grid = grid_of(np.arange(70), 32)
    assert grid.shape == (32, 3) and grid[0].tolist() == [0, 32, 64] and grid_of(np.arange(5), 32).shape == (5, 1)
    with pytest.raises(ValueError, match='nothing to draw'):
        draw([], 'x.png')


def test_notebooks_get_pictures_and_tables():
    dap = Dap.model('510')
    assert 'data:image/png;base64' in dap.matrix(np.eye(40, dtype=bool))._repr_html_()
    assert '<table>' in dap.stats()._repr_html_()


@pytest.mark.parametrize('name', ['sobel', 'roberts', 'canny', 'laplacian_of_gaussian'])
def test_image_programs_turn_pictures_into_pictures(name):
    image = np.zeros((50, 60), np.uint8)
    image[10:40, 15:45] = 200
    program = ImageProgram(name)
    edges = program.run(image)
    assert edges.shape == image.shape and edges.dtype == np.uint8 and program.cycles > 0
    assert edges[8:42, 13:47].any() and not edges[20:30, 25:35].any()


def test_a_program_that_is_no_filter_is_refused():
    with pytest.raises(ValueError, match='no matrix IMAGE'):
        ImageProgram('life')
