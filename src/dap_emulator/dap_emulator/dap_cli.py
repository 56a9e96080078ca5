"""``dap``: run a Fortran-Plus program, see where its cycles go, and draw its planes.

dap list                                       the library
dap run life --example --html life.html        a page that shows every statement at work
dap life -a cells=random:40x40:logical -a generations=12 --show life.gif
dap sobel -a image=picture.png --show edges.png --plane RESULT --listing
dap my.fpp -a a=a.npy -a n=3 --model 610C --save out.npz
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command
from msgs_py.files import check_image, load_array, load_arrays
from msgs_py.numeric.typed import AnyArray

from .fortran_plus import FortranError, Limits, Result, Stopped
from .fortran_plus.examples import Example, example
from .fortran_plus.functions import FUNCTIONS
from .fortran_plus.library import load_program, program_names, summary
from .fortran_plus.running import late_text
from .machine.counted import table as counted_table
from .machine.dap import Dap
from .machine.machine import ARITHMETICS, MODELS, ROUNDINGS, OutOfStore
from .service.settings import LATE_S, LATE_SHARE
from .watch import Recorder, write_page

IMAGE_SUFFIXES = ('.png', '.jpg', '.jpeg', '.bmp', '.pgm', '.tif', '.tiff')


def value_of(text: str) -> Any:
    """Read the value of an argument.

    A number, true or false, a list 1,2,3; a .npy file, or file.npz:name; an image file (grey, INTEGER*2);
    random:ROWSxCOLUMNS[:logical|integer|real][:SEED], zeros:ROWSxCOLUMNS; otherwise text.
    Raises ValueError or OSError.
    """
    low = text.lower()
    if low in ('true', 'false'):
        return low == 'true'
    if low.startswith(('random:', 'zeros:')):
        return _made(text)
    file, _, key = text.partition(':')
    if low.endswith('.npy'):
        return load_array(text)
    if file.lower().endswith('.npz'):
        archive = load_arrays(file)
        if key not in archive:
            raise ValueError(f'{file}: holds {", ".join(archive)}; name one as {file}:NAME')
        return archive[key]
    if Path(text).suffix.lower() in IMAGE_SUFFIXES:
        image = cv2.imread(str(check_image(text)), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ValueError(f'{text}: not an image that can be read')
        return image.astype(np.int16)
    parts = text.split(',')
    try:
        numbers = [int(part) if part.strip().lstrip('+-').isdigit() else float(part) for part in parts]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else np.array(numbers)


def _made(text: str) -> AnyArray:
    """An array of random numbers or zeros. Raises ValueError."""
    what, extents, *rest = text.lower().split(':')
    try:
        shape = tuple(int(extent) for extent in extents.split('x'))
        seed = int(rest[1]) if len(rest) > 1 else 0
        kind = rest[0] if rest else 'real'
    except ValueError:
        raise ValueError(f'{text}: expected for example random:32x32:logical:1') from None
    if min(shape) < 1 or kind not in ('logical', 'integer', 'real'):
        raise ValueError(f'{text}: expected extents of at least 1, and logical, integer or real')
    if what == 'zeros':
        return np.zeros(shape, {'logical': bool, 'integer': np.int16, 'real': np.float32}[kind])
    rng = np.random.default_rng(seed)
    if kind == 'logical':
        return rng.random(shape) < 0.5
    return rng.integers(0, 256, shape).astype(np.int16) if kind == 'integer' else rng.random(shape).astype(np.float32)


def parser() -> argparse.ArgumentParser:
    """The command's options."""
    result = CommandParser(
        prog='dap',
        description=__doc__.split('\n')[0],
        epilog='\n'.join(__doc__.split('\n')[2:]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument(
        'program',
        nargs='?',
        help='a program file, or the name of a library program; the word run may stand before it, and the words list, '
        'functions, costs and counted stand for the options of these names',
    )
    result.add_argument('-x', '--example', action='store_true', help="give a library program its example's arguments")
    result.add_argument(
        '-a',
        '--argument',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help=' '.join((value_of.__doc__ or '').split('\n\n')[1].split()),
    )
    result.add_argument('-e', '--entry', help='which ENTRY SUBROUTINE, when there are several')
    result.add_argument('-m', '--model', default='510', type=str.upper, choices=list(MODELS))
    result.add_argument(
        '--arithmetic',
        default='words',
        choices=ARITHMETICS,
        help='compute on words of this computer, or on bit-planes as the machine did, where cycles are counted as well',
    )
    result.add_argument(
        '--rounding', default='nearest', choices=ROUNDINGS, help='of REALs on bit-planes: to nearest, or cut off'
    )
    result.add_argument('--memory', type=int, metavar='BITS', help='store of one PE in bits')
    result.add_argument(
        '--set', action='append', default=[], metavar='CONSTANT=VALUE', help='override a constant of the cost model'
    )
    result.add_argument('--seconds', type=float, help='stop the program after this time')
    result.add_argument('--listing', action='store_true', help='print the source with the cycles of every line')
    result.add_argument('--trace', type=int, default=0, metavar='N', help='print the last N operations')
    result.add_argument('--show', metavar='FILE', help='draw planes to a PNG, or an animated GIF of every display')
    result.add_argument(
        '--html',
        metavar='FILE.html',
        help='write a page that shows the source with its cycles, and after every statement the planes, the active PEs '
        'and the counters',
    )
    result.add_argument('--plane', help='which argument to draw, instead of what the program displays')
    result.add_argument('--save', metavar='FILE.npz', help="save the entry's arguments after the run")
    result.add_argument('--list', action='store_true', help='list the library programs')
    result.add_argument('--functions', action='store_true', help='describe the functions of the language')
    result.add_argument('--costs', action='store_true', help='print the cost model with its sources')
    result.add_argument(
        '--counted', action='store_true', help='print the cost model beside the instructions counted on bit-planes'
    )
    add_json(result)
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Returns
    -------
    int
        0: it ran; 1: the program failed; 2: an option makes no sense.
    """
    return run_command('dap', _command, parser().parse_args(_words(sys.argv[1:] if argv is None else argv)))


def _command(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints. Raises ValueError or OSError for what makes no sense."""
    if options.list or options.functions or options.counted:
        print(_library() if options.list else _functions() if options.functions else counted_table())
        described = {name: summary(name) for name in program_names()} if options.list else {}
        return DONE, described or {name: function.doc for name, function in FUNCTIONS.items()}
    dap = _machine(options)
    if options.costs:
        print(dap.costs.table())
        return DONE, {'costs': dap.costs.table()}
    if not options.program:
        raise ValueError('name a program, or ask for list, functions, costs or --help')
    try:
        recorder = Recorder(dap) if options.html else None
        result = _run(options, dap, recorder)
        _report(options, dap, result)
        if options.show:
            _show(options, dap, result)
        if options.save:
            arrays: dict[str, Any] = {name: np.asarray(value) for name, value in result.items()}
            np.savez(options.save, **arrays)
        if recorder is not None:
            write_page(options.html, recorder, result, Path(options.program).name)
            print(f'wrote {options.html}')
    except (FortranError, Stopped, OutOfStore) as error:
        print(f'{options.program}: {error}', file=sys.stderr)
        return NOTHING, {'error': str(error)}
    arrays = {name: np.asarray(value) for name, value in result.items()}
    return DONE, {'arguments': arrays, 'printed': result.printed, 'stats': vars(result.stats)}


def _machine(options: argparse.Namespace) -> Dap:
    """The machine that the options describe. Raises ValueError."""
    return Dap.model(
        options.model,
        options.memory,
        costs=_pairs(options.set, float),
        tracing=options.trace > 0,
        arithmetic=options.arithmetic,
        rounding=options.rounding,
    )


def _words(arguments: Sequence[str]) -> list[str]:
    """``dap run NAME`` and ``dap list`` as the options they stand for; a file of such a name is meant by ./list."""
    found = list(arguments)
    if found[:1] == ['run']:
        return found[1:]
    if found and found[0] in ('list', 'functions', 'costs', 'counted'):
        found[0] = f'--{found[0]}'
    return found


def _run(options: argparse.Namespace, dap: Dap, recorder: Recorder | None) -> Result:
    """Run the program that is named. Raises what compiling and running it raise."""
    program = load_program(options.program)
    given = Example(None, {})
    if options.example:
        given = example(options.program)
    arguments = given.arguments | _pairs(options.argument, value_of)
    limits = Limits(seconds=options.seconds)
    watchdog = None
    if options.seconds:
        # The run itself ends between two operations; this is for one that takes longer.
        late = options.seconds + max(LATE_S, LATE_SHARE * options.seconds)
        watchdog = threading.Timer(late, _give_up, (options.program, options.seconds))
        watchdog.daemon = True
        watchdog.start()
    try:
        return program.run(dap, options.entry or given.entry, limits=limits, observer=recorder, **arguments)
    except (FortranError, Stopped, OutOfStore) as error:
        if recorder is not None and recorder.steps:
            # What led to a failure is what one wants to see.
            failed = Result({}, dap.stats(), [], program.source, [f'ended by: {error}'])
            write_page(options.html, recorder, failed, Path(options.program).name)
            print(f'wrote {options.html}, up to the failure')
        raise
    finally:
        if watchdog is not None:
            watchdog.cancel()


def _give_up(name: str, seconds: float) -> None:
    """End the command inside an operation."""
    print(f'{name}: {late_text(seconds)}', file=sys.stderr, flush=True)
    os._exit(1)


def _library() -> str:
    """The library programs, one a line."""
    return '\n'.join(f'{name:24} {summary(name)}' for name in program_names())


def _functions() -> str:
    """The functions of the language, one a line."""
    return '\n'.join(f'{name:12} {function.doc}' for name, function in sorted(FUNCTIONS.items()))


def _pairs(texts: Sequence[str], convert: Callable[[str], Any]) -> dict[str, Any]:
    """Values of NAME=VALUE by name. Raises ValueError."""
    found = {}
    for text in texts:
        name, equals, value = text.partition('=')
        if not equals or not name:
            raise ValueError(f'{text!r}: expected NAME=VALUE')
        try:
            found[name.strip()] = convert(value)
        except ValueError as error:
            raise ValueError(f'{name}: {error}') from None
    return found


def _report(options: argparse.Namespace, dap: Dap, result: Result) -> None:
    """Print the entry's arguments after the run, and what it cost."""
    print(f'{options.program} on a DAP {dap.spec.name}')
    for name, value in result.items():
        if isinstance(value, np.ndarray):
            extents = ' x '.join(str(extent) for extent in value.shape)
            facts = f'{value.sum()} true' if value.dtype == bool else f'{value.min():g} to {value.max():g}'
            print(f'  {name:16} {extents:16} {facts}')
        else:
            print(f'  {name:16} {value}')
    for line in result.printed if not options.listing else ():
        print(line)
    print(result.stats)
    if options.listing:
        print(result.listing())
    for entry in list(dap.trace)[-options.trace :] if options.trace else []:
        print(f'  {entry}')


def _show(options: argparse.Namespace, dap: Dap, result: Result) -> None:
    """Draw planes to a file. Raises ValueError."""
    # Importing matplotlib takes about a second, and only pictures need it.
    from .machine.drawing import draw

    if options.plane:
        if options.plane not in result:
            raise ValueError(f'--plane: {options.plane} is no argument, expected one of {", ".join(result)}')
        frames = [(options.plane.upper(), np.asarray(result[options.plane]), '')]
    else:
        frames = result.displays or [
            (name, value, '') for name, value in result.items() if isinstance(value, np.ndarray) and value.ndim <= 2
        ]
    draw(frames, options.show, dap.es)
    print(f'wrote {options.show}')


if __name__ == '__main__':
    sys.exit(main())
