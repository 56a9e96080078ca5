"""The pruning power of the five constraints (Tables 5.4, 5.5)."""

from __future__ import annotations

from lab import Experiment, Line, Outcome, Plot, Setting, Table, recovered, stating, view
from thesis import CONSTRAINT_ALONE, CONSTRAINT_OFF, VIEWS

from model_matcher import MatchParams, index_model
from model_matcher.interpretation_tree.tables import build_tables
from model_matcher.params import CONSTRAINTS
from msgs_py import FeatureKind


def constraints(setting: Setting) -> Outcome:
    tables, plots, agree = [], [], []
    for name in setting.pick(list(CONSTRAINT_ALONE), ['l_shape_v1']):
        this, printed = view(name), VIEWS[name]
        index = index_model(this.features, this.model)
        own = recovered(name)
        own = own.select(own.kind == FeatureKind.EDGE)
        wide = stating(own, 1e-3 * printed.err_par, 1e-3 * printed.err_per)
        _, pairs, potential, alone = CONSTRAINT_ALONE[name]
        all_on, off = CONSTRAINT_OFF[name]
        table = Table(
            f'{name}: matched pairs, % of all potential matches',
            ['constraints', 'thesis', 'ours, errors of the thesis', 'ours, errors as recovered'],
        )
        counted: dict[str, list[float]] = {}
        cases = (
            [(f'{c} alone', (c,)) for c in CONSTRAINTS]
            + [('all', CONSTRAINTS)]
            + [(f'all but {c}', tuple(k for k in CONSTRAINTS if k != c)) for c in CONSTRAINTS]
        )
        for title, used in cases:
            setting.advance(f'{name}: {title}')
            shares = []
            for data, cone in ((wide, printed.cone_deg), (own, 15.0)):
                sums = build_tables(index, data, MatchParams(constraints=used, max_cone_deg=cone, signs=False)).sums
                n = len(data)
                shares.append(100.0 * float(sums.sum()) / (0.5 * n * (n - 1) * len(index) ** 2))
            counted[title] = shares
            theirs = (
                all_on if title == 'all' else alone[used[0]] if len(used) == 1 else off[title.removeprefix('all but ')]
            )
            table.rows.append([title, round(100.0 * theirs / potential, 2), *(round(s, 2) for s in shares)])
        tables.append(table)
        best = max(CONSTRAINTS, key=lambda c, counted=counted: counted[f'all but {c}'][0])
        agree.append(
            f'{name}: {best} prunes most (thesis: {max(off, key=off.get)}), all together leave '
            f'{counted["all"][0]:.1f} % ({100 * all_on / potential:.1f} %), with our own errors '
            f'{counted["all"][1]:.2f} %'
        )
        titles = [row[0] for row in table.rows]
        plots.append(
            Plot(
                f'{name}: what each constraint leaves',
                'constraints in use',
                '% of potential matches',
                [
                    Line('thesis', titles, [row[1] for row in table.rows], 'bar'),
                    Line('ours, errors of the thesis', titles, [row[2] for row in table.rows], 'bar'),
                    Line('ours, errors as recovered', titles, [row[3] for row in table.rows], 'bar'),
                ],
            )
        )
    return Outcome(
        '; '.join(agree) + '.',
        tables,
        plots,
        [
            'Percentages, because the number of fragments differs: the thesis had 26 and 18, see the poses experiment '
            'for ours. Our constraints use exact ranges, where the thesis takes the corners of a pair only.'
        ],
    )


EXPERIMENTS = [Experiment('constraints', 'Pruning power of the constraints', 'Tables 5.4, 5.5', constraints)]
