"""Completion of the commands' options in bash and zsh: ``python -m model_matcher.completion > FILE``.

The script is made once, from the parsers of the commands, so that pressing TAB starts no Python: loading the libraries
would take longer than typing the word.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable

from csg_renderer.features_cli import features_parser
from csg_renderer.language import scene_names
from csg_renderer.render_cli import render_parser
from dap_emulator.dap_cli import parser as dap_parser
from dap_emulator.fortran_plus.library import program_names
from stereo_recovery.check_rig_cli import check_rig_parser
from stereo_recovery.measure_camera_cli import measure_camera_parser
from stereo_recovery.recover_cli import parser as recover_parser

from .closed_form.bop.bop_cli import bop_parser
from .closed_form.cli import closed_form_parser
from .closed_form.following.track_cli import track_parser
from .closed_form.planning.plan_cli import plan_parser
from .closed_form.recordings.replay_cli import replay_parser
from .closed_form.viewing.view_cli import view_parser
from .index_cli import index_parser
from .match_cli import match_parser

HEAD = """\
# Completion of the commands, for bash; for zsh after: autoload -U +X bashcompinit && bashcompinit
# Made by: python -m model_matcher.completion
"""
# A word after an option with choices is one of them, a word with a dash an option, and any other a name or a file.
FUNCTION = """\
_complete_{name}() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}"
    case "$before" in
{cases}        *)
            if [[ "$word" == -* ]]; then
                COMPREPLY=($(compgen -W "{options}" -- "$word"))
            else
                COMPREPLY=($(compgen -W "{names}" -- "$word") $(compgen -f -- "$word"))
            fi ;;
    esac
}}
complete -o filenames -F _complete_{name} {name}
"""


def script() -> str:
    """The script of all commands."""
    scenes = scene_names()
    commands = (
        (features_parser(), scenes),
        (render_parser(), scenes),
        (closed_form_parser(), scenes),
        (plan_parser(), scenes),
        (match_parser(), scenes),
        (index_parser(), ()),
        (track_parser(), scenes),
        (replay_parser(), scenes),
        (view_parser(), scenes),
        (recover_parser(), ()),
        (check_rig_parser(), ()),
        (measure_camera_parser(), ()),
        (bop_parser(), ()),
        (dap_parser(), ('run', 'list', 'functions', 'costs', 'counted', *program_names())),
    )
    return HEAD + ''.join(function(parser, names) for parser, names in commands)


def function(parser: argparse.ArgumentParser, names: Iterable[str] = ()) -> str:
    """The completion of one command.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    names : iterable of str
        What may stand in place of a file.

    Examples
    --------
    >>> parser = argparse.ArgumentParser('cut')
    >>> _ = parser.add_argument('--side', choices=('left', 'right'))
    >>> '--side) COMPREPLY=($(compgen -W "left right"' in function(parser)
    True
    """
    # argparse has no public list of its options.
    actions = [action for action in parser._actions if action.option_strings]
    cases = ''.join(
        f'        {"|".join(action.option_strings)}) '
        f'COMPREPLY=($(compgen -W "{" ".join(map(str, action.choices))}" -- "$word")) ;;\n'
        for action in actions
        if action.choices
    )
    options = ' '.join(option for action in actions for option in action.option_strings)
    return FUNCTION.format(name=parser.prog, cases=cases, options=options, names=' '.join(names))


if __name__ == '__main__':
    print(script(), end='')
