"""Short runs of the stress commands; the bars are met by the long ones (see their help)."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

STRESS = Path(__file__).resolve().parent / 'stress'


def run(script: str, *arguments: str) -> str:
    command = [sys.executable, str(STRESS / script), *arguments]
    result = subprocess.run(command, capture_output=True, text=True, timeout=110, check=False)
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    return result.stdout


def test_a_few_hundred_malformed_messages_are_all_explained(graph):
    answer = run('fuzz.py', '--messages', '400', '--seed', '7', '--domain', str(graph.domain_id))
    assert 'every input explained' in answer


def test_some_pairs_all_come_back_and_memory_stays(graph):
    # Too few for a percentile that means something, and beside other tests: drift and cost are left alone.
    answer = run('soak.py', '--pairs', '60', '--drift', '10', '--cost', '1000', '--domain', str(graph.domain_id))
    assert '60 pairs: 60 recognised, 0 unanswered' in answer


def test_a_few_hundred_malformed_files_are_read_or_refused_with_words():
    assert 'every file read or refused with words' in run('fuzz_files.py', '--files', '300', '--seed', '3')


def test_hostile_calls_and_programs_leave_the_nodes_answering_within_a_second(graph):
    answer = run('hostile.py', '--calls', '20', '--programs', '6', '--seed', '2', '--domain', str(graph.domain_id))
    assert 'every node answered the next good input within 1 s' in answer


def test_some_certificates_about_data_at_its_limits_hold():
    answer = run('certificates.py', '--cases', '25', '--first-seed', '5', '--seconds', '0.1')
    assert '25 cases from seed 5' in answer and 'false' not in answer
