"""Configurations that validate themselves, stamp synchronisation, and the counters of health."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_py.node_runtime.config import Config, parameter
from msgs_py.node_runtime.health import LONGEST_TEXT, REMEMBERED_PROBLEMS, Health, SequenceGaps, shortened
from msgs_py.node_runtime.stamp_sync import NANOSECONDS, StampSync


@dataclass(frozen=True)
class Example(Config):
    size: int = parameter(512, 'Image size', unit='px', minimum=8, maximum=4096)
    gain: float = parameter(1.5, 'Gain', minimum=0.0)
    mode: str = parameter('a', 'Mode', choices=('a', 'b'))
    on: bool = parameter(True, 'Switch')
    names: tuple[str, ...] = parameter(('x',), 'Names')
    queue: int = parameter(3, 'Queue', name='sync.queue_size')


class TestConfig:
    def test_parameters_describe_the_fields(self):
        specs = {spec.name: spec for spec in Example.parameters()}
        assert list(specs) == ['size', 'gain', 'mode', 'on', 'names', 'sync.queue_size']
        assert specs['size'].range_text == '8 to 4096' and specs['mode'].range_text == "one of 'a', 'b'"

    def test_values_round_trip(self):
        changed = Example().changed({'size': 64, 'gain': 2, 'names': ['p', 'q'], 'sync.queue_size': 9})
        assert (changed.size, changed.gain, changed.names, changed.queue) == (64, 2.0, ('p', 'q'), 9)
        assert Example.from_parameters(changed.as_parameters()) == changed

    @pytest.mark.parametrize(
        ('name', 'value', 'text'),
        [
            ('size', 4, 'out of range, expected 8 to 4096 px'),
            ('size', 64.0, 'an integer'),
            ('size', True, 'an integer'),
            ('gain', float('nan'), 'finite'),
            ('gain', 10**400, 'finite'),
            ('size', 10**400, 'finite'),
            ('gain', -1.0, 'at least 0'),
            ('mode', 'c', "one of 'a', 'b'"),
            ('on', 1, 'true or false'),
            ('names', 'x', 'a list'),
            ('names', [1], 'a string'),
            ('nope', 1, 'unknown'),
        ],
    )
    def test_bad_values_name_the_parameter_and_what_was_expected(self, name, value, text):
        with pytest.raises(ValueError, match=f'parameter {name}: .*{text}'):
            Example().changed({name: value})


class TestStampSync:
    def test_equal_stamps_make_a_set(self):
        sync = StampSync('ab')
        assert sync.add('a', 1, 'a1') is None
        assert sync.add('b', 1, 'b1') == {'a': 'a1', 'b': 'b1'}
        assert sync.counters.sets == 1 and sync.counters.unmatched == 0

    def test_unmatched_messages_are_counted_and_do_not_block(self):
        sync = StampSync('ab', queue_size=2)
        for stamp in range(1, 6):
            sync.add('a', stamp, None)
        assert sync.counters.unmatched == 3
        assert sync.add('b', 5, 'b') is not None
        assert sync.counters.unmatched == 4 and 'do not match' not in (sync.explain() or '')

    def test_a_tolerance_takes_the_nearest(self):
        sync = StampSync('ab', tolerance_ns=10)
        sync.add('a', 100, 'far')
        sync.add('a', 108, 'near')
        assert sync.add('b', 109, 'b')['a'] == 'near'

    def test_of_two_messages_with_one_stamp_the_later_counts(self):
        sync = StampSync('ab')
        sync.add('a', 5, 'stray')
        sync.add('a', 5, 'good')
        assert sync.add('b', 5, 'b') == {'a': 'good', 'b': 'b'} and sync.counters.unmatched == 1

    def test_late_messages_are_dropped_but_a_clock_jump_starts_afresh(self):
        sync = StampSync('ab')
        sync.add('a', 10 * NANOSECONDS, 1)
        sync.add('b', 10 * NANOSECONDS, 1)
        assert sync.add('a', 10 * NANOSECONDS - 5, 1) is None and sync.counters.late == 1
        assert sync.add('a', 2 * NANOSECONDS, 2) is None and sync.counters.clock_jumps == 1
        assert sync.add('b', 2 * NANOSECONDS, 2) is not None

    def test_a_short_loop_is_noticed_when_the_topic_stays_behind(self):
        sync = StampSync('ab', queue_size=3)
        sets = 0
        for stamp in [100, 101, 102, 103, 104, 90, 91, 92, 93, 94, 95, 96]:
            sync.add('a', stamp, None)
            sets += sync.add('b', stamp, None) is not None
        assert sync.counters.clock_jumps == 1 and sets >= 8

    def test_explanations_name_the_silent_topic_and_unmatched_stamps(self):
        sync = StampSync('ab', queue_size=1)
        assert 'nothing received on a, b' in sync.explain()
        sync.add('a', 1, None)
        assert 'nothing received on b' in sync.explain()
        sync.add('b', 2, None)
        sync.add('a', 3, None)
        assert 'do not match' in sync.explain()

    def test_what_lasts_is_lent_to_sets_that_wait_for_it(self):
        sync = StampSync(['left', 'right', 'info'], lasting=['info'])
        assert sync.add('info', 3, 'once') is None
        sync.add('left', 10, 'l1')
        assert sync.overdue() is None and sync.add('right', 10, 'r1') is None
        assert sync.overdue() is None, 'it may be on its way'
        assert sync.overdue() == {'left': 'l1', 'right': 'r1', 'info': 'once'}
        sync.add('left', 20, 'l2')
        assert sync.add('right', 20, 'r2') == {'left': 'l2', 'right': 'r2', 'info': 'once'}, 'the next need not wait'
        assert sync.add('info', 4, 'another') is None and sync.counters.spare == 1
        sync.add('left', 30, 'l3')
        assert sync.add('right', 30, 'r3')['info'] == 'another'
        sync.forget()
        sync.add('left', 5, 'l0')
        assert sync.add('right', 5, 'r0')['info'] == 'another', 'it will not come again'

    def test_what_has_come_to_bear_stamps_is_waited_for_again(self):
        sync = StampSync('abi', lasting='i')
        for stamp in (10, 11):
            sync.add('i', 1, 'old')
            sync.add('a', stamp, 'a')
            sync.add('b', stamp, 'b')
            sync.overdue()
            sync.overdue()
        assert sync.counters.sets == 2
        sync.add('i', 11, 'new')  # late, but of a pair
        sync.add('a', 12, 'a')
        assert sync.add('b', 12, 'b') is None
        assert sync.add('i', 12, 'newer') == {'a': 'a', 'b': 'b', 'i': 'newer'}

    def test_pairs_too_fast_to_wait_are_not_dropped(self):
        sync = StampSync('abi', queue_size=3, lasting='i')
        sync.add('i', 1, 'once')
        found = []
        for stamp in range(10, 30):
            found += [sync.add('a', stamp, stamp), sync.add('b', stamp, stamp)]
        assert [one['a'] for one in found if one] == list(range(12, 30)), 'nothing is waited for after the first'

    @settings(max_examples=200, deadline=None)
    @given(st.lists(st.tuples(st.sampled_from('abci'), st.integers(-5, 20)), max_size=80), st.integers(0, 2))
    def test_every_message_has_a_fate(self, messages, tolerance):
        sync = StampSync('abi', queue_size=3, tolerance_ns=tolerance, jump_ns=15, lasting='i')
        for topic, stamp in messages:
            found = sync.overdue() if topic == 'c' else sync.add(topic, stamp, stamp)
            assert found is None or set(found) == set('abi')
            assert found is None or abs(found['a'] - found['b']) <= 2 * tolerance
        c = sync.counters
        waiting = sum(len(pending) for _, pending in sync._pending)
        assert 3 * c.sets - c.borrowed + c.unmatched + c.late + c.spare + waiting == sum(c.received.values())

    @settings(max_examples=100, deadline=None)
    @given(st.lists(st.tuples(st.sampled_from('abc'), st.integers(-5, 20)), max_size=60), st.integers(0, 2))
    def test_never_grows_never_raises_and_counts_everything(self, messages, tolerance):
        sync = StampSync('abc', queue_size=4, tolerance_ns=tolerance, jump_ns=10)
        for topic, stamp in messages:
            complete = sync.add(topic, stamp, stamp)
            if complete is not None:
                assert max(complete.values()) - min(complete.values()) <= 2 * tolerance
            assert len(sync._pending) <= 4
        sync.forget()
        counters = sync.counters
        assert len(messages) == 3 * counters.sets + counters.unmatched + counters.late

    @pytest.mark.parametrize(
        'arguments',
        [{'topics': 'aa'}, {'topics': ''}, {'topics': 'a', 'queue_size': 0}, {'topics': 'a', 'tolerance_ns': -1}],
    )
    def test_misuse_is_refused(self, arguments):
        with pytest.raises(ValueError, match='topics|queue_size|tolerance_ns'):
            StampSync(**arguments)


class TestHealth:
    def test_rate_and_latency(self):
        health = Health(now=0.0)
        for i in range(50):
            health.done(now=i * 0.1, latency_s=0.02)
        found = health.values(now=5.0)
        assert float(found['rate_hz']) == pytest.approx(10.0, abs=0.3) and found['latency_p50_ms'] == '20.0'
        assert float(Health(0.0).values(1.0)['rate_hz']) == 0.0

    def test_a_problem_is_logged_once_then_counted_then_summed_up(self):
        health = Health(now=0.0)
        assert health.problem(1.0, 'image.data: short') == 'image.data: short'
        assert health.problem(2.0, 'image.data: short') is None
        assert health.problem(40.0, 'image.data: short') == 'image.data: short (and 1 times more)'
        assert health.problems == 3 and health.values(41.0)['last_error_age_s'] == '1.0'

    def test_a_long_text_loses_its_middle_and_a_text_of_the_longest_length_nothing(self):
        assert shortened('a' * LONGEST_TEXT) == 'a' * LONGEST_TEXT
        text = shortened('begin' + 'a' * LONGEST_TEXT + 'end')
        assert text.startswith('begin') and text.endswith('end') and '[...]' in text and len(text) < LONGEST_TEXT

    def test_a_flood_of_different_problems_does_not_grow(self):
        health = Health(now=0.0)
        for i in range(1000):
            health.problem(0.0, f'problem {i}')
        assert len(health._seen) == REMEMBERED_PROBLEMS


@pytest.mark.parametrize(
    ('numbers', 'missed'),
    [((1, 2, 3), 0), ((5, 6, 9), 2), ((1, 4, 5, 11), 7), ((10, 1, 2), 0), ((None, None), 0), ((3, None, 9, 10), 0)],
)
def test_gaps_in_sequence_numbers_are_counted_and_a_restarted_writer_is_none(numbers, missed):
    gaps = SequenceGaps()
    assert sum(gaps.missed(number) for number in numbers) == missed


def test_a_stray_from_the_future_does_not_spoil_the_set_that_has_its_stamp_by_right():
    sync = StampSync(['left', 'right'])
    assert sync.add('right', 5, 'stray') is None
    assert sync.add('left', 3, 'left 3') is None
    assert sync.add('right', 3, 'right 3') == {'left': 'left 3', 'right': 'right 3'}
    assert sync.counters.unmatched == 1
    assert sync.add('left', 5, 'left 5') is None
    assert sync.add('right', 5, 'right 5') == {'left': 'left 5', 'right': 'right 5'}


def test_one_stream_may_run_ahead_of_the_other():
    sync = StampSync(['left', 'right'])
    for stamp in (1, 2, 3):
        assert sync.add('right', stamp, stamp) is None
    assert [sync.add('left', stamp, stamp) for stamp in (1, 2, 3)] == [{'left': k, 'right': k} for k in (1, 2, 3)]
    assert sync.counters.unmatched == sync.counters.late == 0
