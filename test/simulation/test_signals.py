"""What a channel says while it fails: only its measurements change, and never by chance."""

import copy
import itertools
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.messages.batch import Batch, rows_of
from rpud_sim.simulation.commands import Feed
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultRecord, SignalFaults
from rpud_sim.simulation.fields import header_fields, stamp_of
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.topics import CHANNELS

MILLISECOND = 1_000_000
ORIGIN = 1_700_000_000_000_000_000  # stamps need not be simulation time
SIGNAL = [name for name, kind in KINDS.items() if not kind.physical]


@pytest.fixture(scope="module")
def run():
    """100 ms of every channel: (simulation time, message) by channel.

    Before drilling, for in the rock the drill tool is at rest most of the time.
    """
    drill = {"regime": "free", "rotation_model": "friction_drive", "feed_model": "arm"}
    values = {**drill, "telemetry_rate": 1000, "initial_feed": 0.01}
    run = Run(Plan(Beginning(to_settings(values))))
    run.begin(ORIGIN)
    run.apply(Feed("rate", 1e-3))
    messages = {channel: [] for channel in CHANNELS}
    for time, topic, message in rows_of(run.advance_to(100 * MILLISECOND)):
        if topic in messages:
            messages[topic].append((time, message))
    assert min(map(len, messages.values())) > 20
    return messages


def send(channel, messages, *records):
    """Everything that the channel publishes, with the time at which it does."""
    signals = SignalFaults()
    return [
        (time, out)
        for time, message in messages
        for out in passed(signals, channel, time, message, records)
    ]


def passed(signals, channel, time, message, records):
    """Give what a channel publishes in place of a message."""
    found = signals.apply(Batch.of(time, channel, message), records)
    return [fields for _, _, fields in rows_of(found)]


def record(kind, channel, magnitude=math.nan, onset=0, clear=None, number=1):
    return FaultRecord(number, Fault(kind, channel, magnitude), onset, clear)


def leaves(message, path=()):
    for name, value in message.items():
        if isinstance(value, dict):
            yield from leaves(value, (*path, name))
        else:
            yield (*path, name), value


def main_values(published, channel):
    main = CHANNELS[channel].numbers[0]
    return np.array([dict(leaves(message))[main] for _, message in published])


@pytest.mark.parametrize("channel", CHANNELS)
def test_the_table_of_channels_names_everything_that_is_measured(run, channel):
    names = {path for path, _ in leaves(run[channel][0][1]) if path[0] != "header"}
    table = CHANNELS[channel]
    known = {("sequence",), ("impacts",), ("stiffness",), ("damping",)}  # not measured
    assert names - known == {*table.numbers, *table.flags}


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("kind", SIGNAL)
def test_a_fault_touches_measurements_alone_and_only_while_it_lasts(run, kind, channel):
    untouched = copy.deepcopy(run[channel])
    given = record(kind, channel, onset=30 * MILLISECOND, clear=60 * MILLISECOND)
    published = send(channel, run[channel], given)
    assert repr(untouched) == repr(run[channel])  # messages are copied, not changed
    originals = {stamp_of(message): message for _, message in run[channel]}
    measured = {*CHANNELS[channel].numbers, *CHANNELS[channel].flags}
    for _, out in published:
        original = originals[stamp_of(out)]
        assert [path for path, _ in leaves(out)] == [path for path, _ in leaves(original)]
        for (path, value), (_, true) in zip(leaves(out), leaves(original), strict=True):
            assert path in measured or value == true
            assert type(value) is type(true)
        if not given.active_at(stamp_of(out) - ORIGIN):
            assert out == original
    stamps = [stamp_of(out) for _, out in published]
    assert stamps == sorted(stamps)
    # The fault is seen: something is missing, late or other than it was.
    assert [out for _, out in published] != [message for _, message in run[channel]] or any(
        stamp_of(out) - ORIGIN != time for time, out in published
    )


@pytest.mark.parametrize("first", [0, 30])
def test_a_stuck_channel_repeats_what_it_said_last_or_first(run, first):
    messages = run["drill_tool"]
    published = send(
        "drill_tool", messages, record("stuck", "drill_tool", onset=messages[first][0])
    )
    before = messages[max(first - 1, 0)][1]
    assert len(published) == len(messages)
    own = {"header": None, "impacts": None}
    for _, message in published[first:]:
        assert {**message, **own} == {**before, **own}


def forces(value_of, count):
    """Give messages of the reacting force, one each millisecond."""
    return [
        (time, {"header": header_fields("reacting_force", ORIGIN + time), "force": value})
        for time, value in ((n * MILLISECOND, value_of(n)) for n in range(count))
    ]


def said(messages, *records):
    """Give times [ms] and forces that the faulty channel publishes."""
    published = send("reacting_force", messages, *records)
    return [time // MILLISECOND for time, _ in published], main_values(published, "reacting_force")


def test_garbage_is_now_and_then_not_finite_and_otherwise_of_any_size():
    _, values = said(forces(lambda n: 20.0, 2000), record("garbage", "reacting_force"))
    assert np.isnan(values).any()
    assert np.isposinf(values).any()
    assert np.isneginf(values).any()
    sizes = np.abs(values[np.isfinite(values)])
    assert 0.85 < len(sizes) / len(values) < 0.95
    assert np.mean(sizes > 1e100) > 0.2
    assert np.mean(sizes < 1e-100) > 0.2


def test_wrong_scales_every_number_and_bias_moves_the_main_one(run):
    wrong = record("wrong", "contact_force")
    published = send("contact_force", run["contact_force"], wrong)
    for (_, out), (_, true) in zip(published, run["contact_force"], strict=True):
        for (name,) in CHANNELS["contact_force"].numbers:
            assert out[name] == 0.5 * true[name]
    published = send("wrench", run["wrench"], record("bias", "wrench", 3.0))
    moved = main_values(published, "wrench") - main_values(run["wrench"], "wrench")
    np.testing.assert_allclose(moved, 3.0, rtol=1e-12)
    assert all(message["wrench"]["force"]["x"] == 0.0 for _, message in published)


@given(
    period=st.integers(1, 30),
    times=st.lists(st.integers(0, 100), unique=True, min_size=1).map(sorted),
)
def test_a_slow_channel_never_says_more_and_never_less(period, times):
    messages = [forces(float, 101)[time] for time in times]
    told, _ = said(messages, record("slow", "reacting_force", period * 1e-3))
    assert told[0] == times[0]
    assert all(after - before >= period for before, after in itertools.pairwise(told))
    for time in times:  # what was lost came too early after one that went out
        assert time in told or any(0 < time - other < period for other in told)


def test_an_intermittent_channel_loses_its_share():
    kept, _ = said(forces(float, 2000), record("intermittent", "reacting_force", 0.3))
    assert len(kept) == pytest.approx(0.7 * 2000, abs=5 * math.sqrt(2000 * 0.3 * 0.7))


def test_noise_has_its_standard_deviation():
    _, values = said(forces(lambda n: 1.0, 4000), record("noise", "reacting_force", 0.25))
    assert values.mean() == pytest.approx(1.0, abs=5 * 0.25 / math.sqrt(4000))
    assert values.std() == pytest.approx(0.25, rel=0.1)


def test_faults_on_one_channel_act_in_the_order_of_injection():
    for (one, other), value in ((("bias", "wrong"), 22.0), (("wrong", "bias"), 21.0)):
        sizes = {"bias": 1.0, "wrong": 2.0}
        first = record(one, "reacting_force", sizes[one], number=1)
        second = record(other, "reacting_force", sizes[other], number=2)
        for records in ((first, second), (second, first)):
            assert (said(forces(lambda n: 10.0, 3), *records)[1] == value).all()


def test_what_waited_passes_the_faults_behind_the_one_that_ended():
    delayed = record("delayed", "reacting_force", 1.0, clear=MILLISECOND, number=1)
    bias = record("bias", "reacting_force", 1.0, number=2)
    told, values = said(forces(lambda n: 10.0, 2), delayed, bias)
    assert (told, values.tolist()) == ([1, 1], [11.0, 11.0])


KINDS_ON_CHANNELS = st.tuples(st.sampled_from(SIGNAL), st.sampled_from(sorted(CHANNELS)))


@st.composite
def injections(draw):
    found = []
    for kind, channel in draw(st.lists(KINDS_ON_CHANNELS, unique=True, max_size=6)):
        onset = draw(st.integers(0, 100)) * MILLISECOND
        lasting = draw(st.one_of(st.none(), st.integers(1, 100)))
        clear = None if lasting is None else onset + lasting * MILLISECOND
        found.append(record(kind, channel, math.nan, onset, clear, len(found) + 1))
    return tuple(found)


def everything(run, seed, records, channels=tuple(CHANNELS)):
    """Give all that the channels publish, the rest when all faults are over."""
    signals, found = SignalFaults(seed), {}
    for channel in channels:
        found[channel] = [
            out
            for time, message in run[channel]
            for out in passed(signals, channel, time, message, records)
        ]
    for _, channel, out in rows_of(signals.release(10**18, ())):
        found[channel].append(out)
    return found


@given(seed=st.integers(0, 2**63 - 1), records=injections())
def test_the_same_faults_give_the_same_bytes_and_lose_and_double_nothing(run, seed, records):
    first = everything(run, seed, records)
    assert pickle.dumps(everything(run, seed, records)) == pickle.dumps(first)
    for channel, messages in run.items():
        # What happens on one channel does not depend on the others.
        own = tuple(one for one in records if one.fault.channel == channel)
        assert repr(everything(run, seed, own, (channel,))[channel]) == repr(first[channel])
        stamps = [stamp_of(out) for out in first[channel]]
        assert stamps == sorted({*stamps})
        if not {"off", "slow", "intermittent"} & {one.fault.kind for one in own}:
            assert stamps == [stamp_of(message) for _, message in messages]


@pytest.mark.parametrize("kind", ["garbage", "intermittent", "noise"])
def test_another_seed_and_another_number_draw_otherwise(run, kind):
    def noise(seed, number):
        return repr(everything(run, seed, (record(kind, "wrench", number=number),), ("wrench",)))

    assert len({noise(0, 1), noise(1, 1), noise(0, 2)}) == 3
