"""What a channel says while it fails: only its measurements change, and never by chance."""

import copy
import itertools
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.mount import RATE
from rpud_sim.simulation import Parameters, fields
from rpud_sim.simulation.commands import Feed
from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultRecord
from rpud_sim.simulation.fields import process_fields
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.signals import SignalFaults
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.telemetry import row_of
from rpud_sim.simulation.topics import CHANNELS

MILLISECOND = 1_000_000
ORIGIN = 1_700_000_000_000_000_000  # stamps need not be simulation time
SIGNAL = [name for name, kind in KINDS.items() if not kind.physical]


@pytest.fixture(scope="module")
def run():
    """100 ms of every channel: (simulation time, message) by channel.

    Before drilling, for in the rock the drill tool is at rest most of the time.
    """
    block = Simulation(Parameters(regime="free")).advance_to(100 * MILLISECOND)
    times = [number * MILLISECOND for number in range(101)]
    samples = block.sample(Times.from_nanoseconds(np.array(times)))
    stamps = ORIGIN + np.array(times)
    columns = {topic: fields.sampled_fields(topic, samples, stamps) for topic in fields.SAMPLED}
    columns["wrench"] = fields.wrench_fields(samples, stamps)
    messages = {
        channel: [(time, row_of(made, number)) for number, time in enumerate(times)]
        for channel, made in columns.items()
    }
    made = fields.contact_force_fields(block.impacts, ORIGIN)
    impacts = [row_of(made, number) for number in range(len(block.impacts))]
    messages["contact_force"] = [(fields.stamp_of(one) - ORIGIN, one) for one in impacts]
    assert len(impacts) > 20
    return {**messages, **_slow_processes(times)}


def _slow_processes(times):
    """The messages of rotation and mount of a drill whose feed moves."""
    drill = {
        "rotation_model": "friction_drive",
        "feed_model": "arm",
        "rock_model": "specific_energy",
        "initial_feed": 0.01,
    }
    simulation = Simulation(to_configuration(drill))
    simulation.apply(Feed(RATE, 1e-3))
    messages = {"rotation": [], "mount": []}
    for time in times:
        simulation.advance_to(time)
        for channel, sent in messages.items():
            stamps = np.array([ORIGIN + time])
            ((_, made),) = process_fields(channel, [simulation.process], stamps)
            sent.append((time, row_of(made, 0)))
    return messages


def send(signals, channel, messages, records):
    """Everything that the channel publishes, with the time at which it does."""
    published = []
    for time, message in messages:
        published += [(time, out) for out in signals.apply(channel, time, message, records)]
    return published


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
    assert names - {("sequence",)} == {*table.numbers, *table.flags}


@pytest.mark.parametrize("channel", CHANNELS)
def test_a_healthy_channel_publishes_the_very_message(run, channel):
    other = "wrench" if channel != "wrench" else "drill_tool"
    for records in ((), (record("off", other),), (record("off", channel, clear=0),)):
        published = send(SignalFaults(), channel, run[channel], records)
        assert all(
            out is message for (_, out), (_, message) in zip(published, run[channel], strict=True)
        )


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("kind", SIGNAL)
def test_a_fault_touches_measurements_alone_and_only_while_it_lasts(run, kind, channel):
    untouched = copy.deepcopy(run[channel])
    given = record(kind, channel, onset=30 * MILLISECOND, clear=60 * MILLISECOND)
    published = send(SignalFaults(), channel, run[channel], (given,))
    assert repr(untouched) == repr(run[channel])  # messages are copied, not changed
    originals = {fields.stamp_of(message): message for _, message in run[channel]}
    measured = {*CHANNELS[channel].numbers, *CHANNELS[channel].flags}
    for _, out in published:
        original = originals[fields.stamp_of(out)]
        assert [path for path, _ in leaves(out)] == [path for path, _ in leaves(original)]
        for (path, value), (_, true) in zip(leaves(out), leaves(original), strict=True):
            assert path in measured or value == true
            assert type(value) is type(true)
        if not given.lasts_at(fields.stamp_of(out) - ORIGIN):
            assert out is original
    stamps = [fields.stamp_of(out) for _, out in published]
    assert stamps == sorted(stamps)
    # The fault is seen: something is missing, late or other than it was.
    assert [out for _, out in published] != [message for _, message in run[channel]] or any(
        fields.stamp_of(out) - ORIGIN != time for time, out in published
    )


def test_a_stuck_channel_repeats_what_it_said_last_or_first(run):
    for onset in (0, 30):
        given = record("stuck", "drill_tool", onset=onset * MILLISECOND)
        published = send(SignalFaults(), "drill_tool", run["drill_tool"], (given,))
        before = run["drill_tool"][max(onset - 1, 0)][1]
        assert len(published) == len(run["drill_tool"])
        for _, message in published[onset:]:
            for name in ("displacement", "velocity", "in_contact"):
                assert message[name] == before[name]


def forces(value_of, count):
    """Give messages of the reacting force, one each millisecond."""
    return [
        (time, {"header": fields.header_fields("reacting_force", ORIGIN + time), "force": value})
        for time, value in ((n * MILLISECOND, value_of(n)) for n in range(count))
    ]


def said(messages, *records):
    """Give times [ms] and forces that the faulty channel publishes."""
    published = send(SignalFaults(), "reacting_force", messages, records)
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
    [wrong] = [record("wrong", "contact_force")]
    published = send(SignalFaults(), "contact_force", run["contact_force"], (wrong,))
    for (_, out), (_, true) in zip(published, run["contact_force"], strict=True):
        for (name,) in CHANNELS["contact_force"].numbers:
            assert out[name] == 0.5 * true[name]
    published = send(SignalFaults(), "wrench", run["wrench"], (record("bias", "wrench", 3.0),))
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


def test_late_messages_come_although_the_channel_falls_silent():
    signals = SignalFaults()
    given = (record("delayed", "contact_force", 1.0),)
    message = {"header": fields.header_fields("reacting_force", 0), "sequence": 0}
    assert signals.apply("contact_force", 0, message, given) == []
    assert signals.release(999_999_999, given) == []
    assert signals.release(1_000_000_000, given) == [("contact_force", message)]
    assert signals.release(2_000_000_000, given) == []


def test_an_intermittent_channel_loses_its_share():
    kept, _ = said(forces(float, 2000), record("intermittent", "reacting_force", 0.3))
    assert len(kept) == pytest.approx(0.7 * 2000, abs=5 * math.sqrt(2000 * 0.3 * 0.7))


def test_noise_has_its_standard_deviation():
    _, values = said(forces(lambda n: 1.0, 4000), record("noise", "reacting_force", 0.25))
    assert values.mean() == pytest.approx(1.0, abs=5 * 0.25 / math.sqrt(4000))
    assert values.std() == pytest.approx(0.25, rel=0.1)


def test_faults_on_one_channel_act_in_the_order_of_injection():
    messages = forces(lambda n: 10.0, 3)
    for order, value in ((("bias", "wrong"), 22.0), (("wrong", "bias"), 21.0)):
        sizes = {"bias": 1.0, "wrong": 2.0}
        records = [
            record(kind, "reacting_force", sizes[kind], number=number)
            for number, kind in enumerate(order, 1)
        ]
        for given_now in (records, records[::-1]):
            assert (said(messages, *given_now)[1] == value).all()


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
    signals = SignalFaults(seed)
    return {channel: send(signals, channel, run[channel], records) for channel in channels}


@given(seed=st.integers(0, 2**63 - 1), records=injections())
def test_the_same_seed_and_injections_give_the_same_bytes(run, seed, records):
    first = everything(run, seed, records)
    again = everything(run, seed, records)
    assert pickle.dumps(first) == pickle.dumps(again)
    # What happens on one channel does not depend on the others.
    for channel in CHANNELS:
        own = tuple(one for one in records if one.fault.channel == channel)
        alone = everything(run, seed, own, (channel,))
        assert repr(alone[channel]) == repr(first[channel])


@pytest.mark.parametrize("kind", ["garbage", "intermittent", "noise"])
def test_another_seed_and_another_number_draw_otherwise(run, kind):
    def noise(seed, number):
        return repr(everything(run, seed, (record(kind, "wrench", number=number),), ("wrench",)))

    assert len({noise(0, 1), noise(1, 1), noise(0, 2)}) == 3


@given(records=injections())
def test_no_message_is_lost_or_doubled_unless_a_fault_loses_it(run, records):
    signals = SignalFaults()
    for channel, messages in run.items():
        published = send(signals, channel, messages, records)
        # With all faults over, everything that waited is out.
        published += [(0, out) for name, out in signals.release(10**18, ()) if name == channel]
        stamps = [fields.stamp_of(out) for _, out in published]
        assert stamps == sorted({*stamps})
        if not any(
            one.fault.channel == channel and one.fault.kind in ("off", "slow", "intermittent")
            for one in records
        ):
            assert stamps == [fields.stamp_of(message) for _, message in messages]
