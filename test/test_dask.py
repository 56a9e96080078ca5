"""Commands on a dask cluster: the same results as in one process; what was done is kept, failures are named."""

from __future__ import annotations

import importlib
import json
import math

import pytest

from csg_renderer.language.includes import models_folder
from model_matcher import index_cli
from model_matcher.batches.jobs import Store, Workers, run_jobs
from model_matcher.closed_form.planning.plan_cli import main as plan_rig

distributed = pytest.importorskip('distributed', reason='dask.distributed is not installed (pip install distributed)')

PLAN = ['wedge', '--distance', '180', '260', '--size', '320', '240', '--focal', '380', '--baseline', '50', '-q']
FEW = ['--views', '4', '--trials', '2', '--empty', '1', '--clutter', '1']


@pytest.fixture(scope='module', params=[1, 2], ids=['one thread', 'two threads'])
def address(request):
    """Of a cluster of two workers; by default a worker of dask has as many threads as its machine has cores."""
    threads = request.param
    with distributed.LocalCluster(
        2, threads_per_worker=threads, dashboard_address=None, worker_dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


def test_an_index_is_the_same_whoever_reads_its_files(address, tmp_path):
    folder = tmp_path / 'parts'
    folder.mkdir()
    for name in ('l_shape', 'wedge', 'lamp', 'l_shape_v1', 'printed_goods', 'carton.png'):
        name = name if '.' in name else f'{name}.csg'
        for source in models_folder().glob(name):
            (folder / name).write_bytes(source.read_bytes())
    made = {}
    for who in (['--workers', '1'], ['--dask', address]):
        index = tmp_path / f'{len(made)}.index'
        assert index_cli.main([str(folder), '-o', str(index), '-q', *who]) == 0
        made[who[0]] = index.read_bytes()
    assert made['--workers'] == made['--dask']


def test_a_plan_is_the_same_whoever_tries_its_views(address, tmp_path):
    results = {}
    for who in (['--workers', '1'], ['--dask', address]):
        out = tmp_path / who[0].strip('-')
        assert plan_rig([*PLAN, *FEW, *who, '-o', str(out)]) in (0, 1)
        lines = [json.loads(line) for line in (out / 'results.jsonl').read_text().splitlines()[1:]]
        # What a search took is that of whoever made it.
        results[who[0]] = {one['job']: {k: v for k, v in one['result'].items() if k != 'milliseconds'} for one in lines}
    assert len(results['--dask']) == 7 and results['--dask'] == results['--workers']


def test_what_a_cluster_has_done_is_kept_when_a_job_fails(address, tmp_path):
    jobs = {str(number): number for number in (1, 4, 9, 16)}
    store = tmp_path / 'results.jsonl'
    far = Workers(dask=address, quiet=True)
    run_jobs(math.sqrt, {'1': 1}, far, Store(store, {}))
    with pytest.raises(ValueError, match='math domain error'):
        run_jobs(math.sqrt, {**jobs, 'none': -1}, far, Store(store, {}))
    done = run_jobs(math.sqrt, jobs, far, Store(store, {}))
    assert done == {'1': 1.0, '4': 2.0, '9': 3.0, '16': 4.0}
    assert len(store.read_text().splitlines()) == 5  # none was done twice


def test_a_worker_that_lacks_software_is_reported_in_one_line(address, tmp_path, monkeypatch):
    (tmp_path / 'only_here.py').write_text('def twice(number):\n    return 2 * number\n')
    monkeypatch.syspath_prepend(tmp_path)
    twice = importlib.import_module('only_here').twice
    with pytest.raises(ValueError, match="a worker lacks software that this machine has: No module named 'only_here'"):
        run_jobs(twice, {'one': 1}, Workers(dask=address, quiet=True))
