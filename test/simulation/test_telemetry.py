"""What goes out of a run is complete, at its times, and the same block by block and in spans."""

import itertools
from collections import defaultdict
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.messages.batch import groups, rows_of
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.definitions import find_definition
from rpud_sim.simulation import Parameters, fields
from rpud_sim.simulation.block import boundary
from rpud_sim.simulation.changes import Change, ChangeError, Inject, SetOrigin
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.plan import Beginning, Journal, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.topics import TOPICS

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
END = 200 * MILLISECOND
ORIGIN = 1_700_000_000 * SECOND + 7
SENSORS = ("nodal_plane", "drill_tool", "reacting_force", "wrench")


def periods(rate, end=END):
    """The ends of all telemetry periods until a time."""
    numbers = itertools.count(1)
    return list(itertools.takewhile(lambda time: time <= end, (boundary(n, rate) for n in numbers)))


def started(values=None, faults=(), **options):
    run = Run(Plan(Beginning(to_settings(values or {}), faults=tuple(faults))), **options)
    run.begin(ORIGIN)
    return run


def published(run, *times):
    """Everything that goes out until the last of the times, as (time, message) by topic."""
    found = defaultdict(list)
    for messages in (*map(run.advance_to, times), run.flush()):
        for time, topic, values in rows_of(messages):
            found[topic].append((time, values))
    return found


def stamps(messages):
    return [fields.stamp_of(values) for _, values in messages]


@pytest.mark.parametrize("rate", [100, 333, 1000])
def test_sensors_are_sampled_at_the_boundaries_alone(rate):
    found = published(started({"telemetry_rate": rate}), *range(7_654_321, END, 7_654_321), END)
    due = periods(rate)
    whole = Simulation(Parameters()).advance_to(END)
    samples = whole.sample(Times.from_nanoseconds(np.array(due)))
    for topic in (*SENSORS, "joint_states"):
        assert [time for time, _ in found[topic]] == due
        assert stamps(found[topic]) == [ORIGIN + time for time in due]
    positions = [values["position"] for _, values in found["nodal_plane"]]
    assert positions == samples.nodal_plane_position.tolist()
    # Every impact is told once and in order.
    for name in ("sequence", "peak_force"):
        assert [values[name] for _, values in found["contact_force"]] == whole.impacts[
            name
        ].tolist()
    times = [time for time, _ in found["contact_force"]]
    assert times == sorted(times)


def test_streams_come_in_blocks_without_a_gap_and_the_rest_at_the_end():
    end = END - 3_210_987
    found = published(started({"sample_rate": 48_000, "block_duration": 0.03}), end)
    whole = Simulation(Parameters()).advance_to(end)
    ends = [30, 60, 90, 120, 150, 180]
    assert [time for time, _ in found["waveform"]] == [ms * MILLISECOND for ms in ends] + [end]
    for topic, name in (("waveform", "contact_force"), ("trajectory", "duration")):
        lengths = [len(values[name]) for _, values in found[topic]]
        sequences = [values["sequence"] for _, values in found[topic]]
        assert sequences == [0, *itertools.accumulate(lengths[:-1])]
        if topic == "waveform":
            assert lengths[:-1] == [1440] * 6
            samples = whole.sample(Times.from_grid(0, sum(lengths), 48_000))
    forces = np.concatenate([values["contact_force"] for _, values in found["waveform"]])
    assert (forces == samples.contact_force).all()
    assert sum(lengths) == len(whole.segments)


def fault(onset, clear, fault):
    """Return the injection of a fault between two times [ms]."""
    duration = (clear - onset) * MILLISECOND if clear else 0
    return Change(onset * MILLISECOND, Inject(fault, duration))


PLANNED = (
    fault(0, None, Fault("noise", "wrench")),
    fault(20, 95, Fault("delayed", "nodal_plane", 0.03)),
    fault(50, None, Fault("slow", "drill_tool", 0.025)),
    fault(70, 130, Fault("off", "reacting_force")),
)


def test_faults_act_on_their_channel_and_the_ground_truth_stays():
    healthy, faulty = (published(started(faults=each), END) for each in ((), PLANNED))
    for topic in ("waveform", "trajectory", "joint_states", "contact_force"):
        assert repr(faulty[topic]) == repr(healthy[topic])
    assert stamps(faulty["wrench"]) == stamps(healthy["wrench"])
    assert faulty["wrench"] != healthy["wrench"]
    silent = [time for time in periods(100) if 70 * MILLISECOND <= time < 130 * MILLISECOND]
    kept = [message for message in healthy["reacting_force"] if message[0] not in silent]
    assert faulty["reacting_force"] == kept
    slow = [time // MILLISECOND for time, _ in faulty["drill_tool"]]
    assert slow == [10, 20, 30, 40, 50, 80, 110, 140, 170, 200]
    # The fault begins with the sample at 20 ms; its end, seen at 100 ms, lets go what waits.
    times = [time for time, _ in faulty["nodal_plane"]]
    made = np.array(stamps(faulty["nodal_plane"])) - ORIGIN
    late = (np.array(times) - made) // MILLISECOND
    assert late.tolist() == [0] + [30] * 5 + [30, 20, 10] + [0] * 11
    assert made.tolist() == periods(100)


def test_what_has_no_listener_is_left_out_but_counted():
    heard = set()
    run = started(wanted=heard.__contains__)
    found = published(run, END // 2)
    assert set(found) == {*SENSORS, "contact_force", "faults"}
    heard |= {"trajectory", "waveform", "joint_states"}
    more = published(run, END)
    before = len(Simulation(Parameters()).advance_to(END // 2).segments)
    assert more["trajectory"][0][1]["sequence"] == before
    assert more["waveform"][0][1]["sequence"] == 5000
    assert stamps(more["waveform"])[0] == ORIGIN + END // 2
    assert len(more["joint_states"]) == 10


COUNTING = ("nodal_plane", "drill_tool", "reacting_force")


def counts(messages):
    """Number of impacts that each message names, by its stamp."""
    return {fields.stamp_of(values): values["impacts"] for _, values in messages}


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_the_impacts_of_a_sample_are_those_that_had_ended(regime):
    found = published(started({"telemetry_rate": 1000, "regime": regime}), END)
    impacts = Simulation(to_settings({"regime": regime}).configuration).advance_to(END).impacts
    ended = impacts["seconds"] + impacts["fraction"]
    if regime == "drilling":  # before drilling an impact takes no time
        ended = ended + impacts["contact_duration"]
    for topic in COUNTING:
        for stamp, count in counts(found[topic]).items():
            time = (stamp - ORIGIN) / SECOND
            assert (ended < time - 1e-9).sum() <= count <= (ended < time + 1e-9).sum()
        assert count > 50


@pytest.mark.parametrize("kind", ["off", "intermittent", "slow", "delayed"])
def test_an_impact_counts_also_if_a_fault_loses_its_message(kind):
    lost = [fault(30, None, Fault(kind, "contact_force"))]
    healthy, faulty = (published(started(faults=each), END) for each in ((), lost))
    assert faulty["contact_force"] != healthy["contact_force"]
    for topic in COUNTING:
        assert counts(faulty[topic]) == counts(healthy[topic])


CODECS = {name: Codec(topic.type, find_definition(topic.type)) for name, topic in TOPICS.items()}
VALUES = st.fixed_dictionaries(
    {
        "regime": st.sampled_from(["free", "drilling"]),
        "weight_on_bit": st.sampled_from([0.0, 10.0, 60.0]),
        "telemetry_rate": st.sampled_from([7, 100, 300, 1000]),
        "sample_rate": st.sampled_from([10, 777, 1000, 20_000]),
        "block_duration": st.sampled_from([0.15, 0.2, 1.0]),
    },
    optional={
        "actuator_model": st.just("resonance"),
        "rock_model": st.just("specific_energy"),
        "command_timeout": st.just(0.1),
        "feed_model": st.just("arm"),
        "initial_feed": st.just(0.004),
    },
).filter(lambda values: values["block_duration"] * values["telemetry_rate"] >= 1.0)
FAULTS = st.builds(Fault, st.just("lost_preload"), st.just(""), st.floats(0.1, 0.9)) | (
    st.sampled_from(
        [
            Fault("stuck", "wrench"),
            Fault("delayed", "drill_tool", 0.02),
            Fault("noise", "contact_force", 1.0),
            Fault("off", "nodal_plane"),
        ]
    )
)
TIMES = st.integers(0, 900 * MILLISECOND)
LENGTHS = st.integers(0, 300 * MILLISECOND)


@st.composite
def scenarios(draw):
    chosen = draw(st.lists(FAULTS, max_size=2, unique_by=lambda fault: fault.channel))
    return tuple(Change(draw(TIMES), Inject(each, draw(LENGTHS))) for each in chosen)


COMMANDS = st.sampled_from(
    [WeightOnBit(0.0), WeightOnBit(25.0), Drive(False, 0.0, 0.0), SetOrigin(7)]
)
STEPS = st.lists(st.tuples(TIMES, st.none() | COMMANDS | FAULTS), max_size=4)


def serialized(messages):
    """Messages as bytes, so that NaN equals NaN and nothing else what has other bits."""
    return [(time, topic, CODECS[topic].encode(fields)) for time, topic, fields in messages]


def told(values, faults, steps, *, by_block):
    """Messages of a run under commands and faults, block by block or as far as it goes at once."""
    return serialized(rows(values, faults, steps, by_block=by_block))


def rows(values, faults, steps, *, by_block):
    plan = Plan(Beginning(to_settings(values), 0.3, 5, faults))
    run = Run(plan, Journal(), rejected=lambda *rejected: None)
    run.begin(ORIGIN)
    batches = []
    for number, (time, change) in enumerate(
        [*sorted(steps, key=lambda step: step[0]), (SECOND, None)]
    ):
        while by_block and run.time < time:
            batches += run.advance_to(min(run.next_boundary, time))
        batches += run.advance_to(time)
        batches.append(run.status())
        if isinstance(change, Fault):
            with suppress(ChangeError):  # it may be there already
                run.apply(Inject(change, 50 * MILLISECOND * (number % 2)))
        elif isinstance(change, WeightOnBit) and "feed_model" in values:
            run.apply(Feed("rate", 1e-4 * change.force))
        elif isinstance(change, SetOrigin) or change is not None:
            run.apply(change)
        batches += run.changes()
    return rows_of([*batches, *run.flush(ends=True)])


@settings(max_examples=examples(12))
@given(VALUES, scenarios(), STEPS)
@example({}, (fault(0, 300, Fault("off", "wrench")),), [])
@example({}, (fault(0, 300, Fault("lost_preload")),), [])
def test_spans_of_blocks_give_the_same_as_block_by_block(values, faults, steps):
    expected = told(values, faults, steps, by_block=True)
    assert told(values, faults, steps, by_block=False) == expected


@pytest.mark.parametrize("by_block", [True, False])
@settings(max_examples=examples(12))
@given(VALUES, st.lists(st.tuples(TIMES, COMMANDS), max_size=3))
@example({}, [(300 * MILLISECOND, SetOrigin(7))])
def test_a_sample_has_as_many_impacts_as_were_published_before_it(by_block, values, steps):
    before = samples = 0
    for _, topic, message in rows(values, (), steps, by_block=by_block):
        if topic == "contact_force" and message["sequence"] == before:
            before += 1
        elif topic in COUNTING:
            samples += 1
            assert message["impacts"] == before
    assert samples >= 3 * values.get("telemetry_rate", 100)


def together(values, *times):
    """Give what a run without changes gives up to each time: the batches of each span."""
    run = Run(Plan(Beginning(to_settings(values))), Journal())
    run.begin(ORIGIN)
    return [[each for each in groups(run.advance_to(time)) if each[0].group] for time in times]


@pytest.mark.parametrize("model", ["gain", "resonance"])
def test_without_changes_four_seconds_are_a_batch_of_each_topic(model):
    [found] = together({"actuator_model": model}, 6 * SECOND)
    assert [max(int(batch.publish_times[-1]) for batch in span) for span in found] == [
        4 * SECOND,
        6 * SECOND,
    ]
    assert all(len({batch.topic for batch in span}) == len(span) for span in found)


def test_each_message_names_its_frame_with_the_prefix():
    plain, left = (published(started({"frame_prefix": each}), END) for each in ("", "left_"))
    assert set(plain) == set(left)
    for topic, messages in left.items():
        frames = [each["header"]["frame_id"] for _, each in plain[topic]]
        assert [each["header"]["frame_id"] for _, each in messages] == [f"left_{f}" for f in frames]
    names = [f"left_{joint}" for joint in fields.JOINTS]
    assert left["joint_states"][0][1]["name"] == names
