"""Every experiment: ``make experiments`` or ``python test/experiments/run.py [--only NAME ...] [--force]``.

Each writes out/experiments/NAME.json; one that is there is not run again unless --force. --workers N runs so many
beside each other, --dask on a cluster. The page index.html and, with a complete set of results, RESULTS.md beside this
file are written from those files.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE))
sys.path.append(str(HERE.parent / 'benchmarks'))
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

from lab import Experiment, NotAvailable, Setting  # noqa: E402
from page import write_page, write_results  # noqa: E402
from results import keep  # noqa: E402
from tqdm import tqdm  # noqa: E402

from model_matcher.batches.jobs import Workers, add_worker_options, runner, workers_of  # noqa: E402

# The order of the page.
GROUPS = (
    'exp_tiling',
    'exp_traversal',
    'exp_scenes',
    'exp_constraints',
    'exp_search',
    'exp_matching',
    'exp_agreement',
    'exp_poses',
    'exp_plug',
    'exp_beyond',
    'exp_images',
)


def experiments() -> list[Experiment]:
    return [item for group in GROUPS for item in importlib.import_module(group).EXPERIMENTS]


def main(arguments: list[str] | None = None) -> int:
    known = {item.name: item for item in experiments()}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--only', nargs='+', default=[], metavar='NAME', help='run these; --list names them')
    parser.add_argument('--force', action='store_true', help='run again what has a result')
    parser.add_argument('--record', action='store_true', help='keep them in benchmarks/results/, which pages quote')
    parser.add_argument('--tiny', action='store_true', help='the smallest run of each, to test the plumbing')
    parser.add_argument('--out', type=Path, default=ROOT / 'out' / 'experiments', help='folder of the results')
    add_worker_options(parser)  # times measured beside other experiments are longer
    parser.add_argument('--list', action='store_true', help='name the experiments and stop')
    options = parser.parse_args(arguments)
    if options.list:
        print(
            '\n'.join(
                f'{item.name:<18} {item.title} ({item.reference or "beyond the thesis"})' for item in known.values()
            )
        )
        return 0
    unknown = [name for name in options.only if name not in known]
    if unknown:
        parser.error(f'--only: no experiment {unknown[0]!r}; there are {", ".join(known)}')
    options.out.mkdir(parents=True, exist_ok=True)
    chosen = [known[name] for name in options.only] or list(known.values())
    started = time.perf_counter()
    failed = []
    stopped = False
    try:
        left = [one for one in chosen if options.force or not is_done(options.out / f'{one.name}.json', options.tiny)]
        with tqdm(
            total=len(chosen), initial=len(chosen) - len(left), desc='experiments', unit='', file=sys.stdout
        ) as bar:
            for item, document, page in conducted(left, options.tiny, workers_of(options), bar):
                path = options.out / f'{item.name}.json'
                document['view'] = page is not None
                if page is not None:
                    (options.out / f'{item.name}.html').write_text(page, encoding='utf-8')
                whole = path.with_suffix('.part')  # who is killed while writing leaves no half of a result
                whole.write_text(json.dumps(document, indent=1, default=plain) + '\n')
                whole.replace(path)
                if options.record and document['status'] == 'done':
                    keep(f'experiment_{item.name}', figures_of(document))
                if document['status'] == 'failed':
                    failed.append(item.name)
                    tqdm.write(document['why'], file=sys.stderr)
    except KeyboardInterrupt:
        stopped = True
    documents = [
        json.loads(path.read_text()) for item in known.values() if (path := options.out / f'{item.name}.json').exists()
    ]
    write_page(options.out, documents)
    if len(documents) == len(known) and not any(document['tiny'] for document in documents):
        write_results(HERE / 'RESULTS.md', documents)
    states = [document['status'] for document in documents]
    print(
        f'{states.count("done")} done, {states.count("not available yet")} not available yet, '
        f'{states.count("failed")} failed; {time.perf_counter() - started:.0f} s; open {options.out}/index.html'
    )
    if stopped:
        print('stopped; the same command goes on with the next experiment')
        return 130
    return 1 if failed else 0


def conducted(
    items: list[Experiment], tiny: bool, workers: Workers, bar: tqdm
) -> Iterator[tuple[Experiment, dict[str, Any], str | None]]:
    """Each with what :func:`conduct` gives, as they are done; in this process with the steps of each shown."""
    if workers.count == 1 and workers.dask is None:
        for item in items:
            bar.set_postfix_str(item.name)
            yield item, *conduct(item, tiny)
            bar.update()
        return
    by_name = {item.name: item for item in items}
    with runner(workers) as run:
        for (name, _), (document, page) in run(_conduct_one, [(name, tiny) for name in by_name]):
            yield by_name[name], document, page
            bar.update()


def _conduct_one(job: tuple[str, bool]) -> tuple[dict[str, Any], str | None]:
    """An experiment by its name, in another process."""
    name, tiny = job
    return conduct(next(item for item in experiments() if item.name == name), tiny, shown=False)


def conduct(item: Experiment, tiny: bool, shown: bool = True) -> tuple[dict[str, Any], str | None]:
    """Run one; a missing capability and a failure are results too. Its document, and its view in space as HTML.

    shown : its steps, as a bar
    """
    page = None
    document: dict[str, Any] = {
        'name': item.name,
        'title': item.title,
        'reference': item.reference,
        'tiny': tiny,
        'command': item.command,
        'commit': commit(),
        'status': 'done',
        'why': '',
    }
    started = time.perf_counter()
    with tqdm(desc=f'  {item.name:<18}', unit='step', leave=False, file=sys.stdout, disable=not shown) as bar:

        def advance(what: str) -> None:
            bar.set_postfix_str(what)
            bar.update()

        try:
            outcome = item.run(Setting(tiny, advance))
            document.update(outcome.as_dict())
            page = outcome.page
        except NotAvailable as missing:
            document.update(status='not available yet', why=str(missing))
        except Exception:  # one broken experiment must not cost the others
            document.update(status='failed', why=traceback.format_exc())
    document['seconds'] = round(time.perf_counter() - started, 1)
    return document, page


def figures_of(document: dict[str, Any]) -> dict[str, Any]:
    """The sentence, and the tables by title, row and column."""
    tables = {
        table['title']: {str(row[0]): dict(zip(table['columns'][1:], row[1:])) for row in table['rows']}
        for table in document['tables']
    }
    return {'sentence': document['sentence'], **tables}


def is_done(path: Path, tiny: bool) -> bool:
    """A result that stands: there, complete, and no smaller than what is asked for."""
    try:
        document = json.loads(path.read_text())
    except (OSError, ValueError):
        return False
    return document['status'] == 'done' and (tiny or not document['tiny'])


def plain(value: Any) -> Any:
    """numpy values in JSON."""
    if hasattr(value, 'tolist'):
        return value.tolist()
    raise TypeError(f'cannot write {type(value).__name__} as JSON')


def commit() -> str:
    """The commit that is measured; 'unknown' without git, and in a source archive."""
    try:
        done = subprocess.run(
            ['git', 'describe', '--always', '--dirty'], capture_output=True, text=True, cwd=ROOT, check=False
        )
    except FileNotFoundError:
        return 'unknown'
    return done.stdout.strip() or 'unknown'


if __name__ == '__main__':
    sys.exit(main())
