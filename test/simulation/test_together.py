"""Messages that a run gives together are those that it gives one by one, bit for bit."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.inspection.offline_bag import encoded
from rpud_sim.model.engine import Engine, EngineError
from rpud_sim.model.parameters import preset
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.scenario import Scenario, ScheduledFault
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import account_of
from rpud_sim.simulation.telemetry import Together, one_by_one
from rpud_sim.simulation.topics import TOPICS

MILLISECOND = 1_000_000
SECOND = 1_000_000_000
ORIGIN = 1_700_000_000 * SECOND + 7
CODECS = {name: Codec(topic.type, find_definition(topic.type)) for name, topic in TOPICS.items()}
ENCODERS = {name: codec.encoder for name, codec in CODECS.items()}
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
)
FAULTS = st.builds(
    Fault,
    st.just("lost_preload"),
    st.just(""),
    st.floats(0.1, 0.9),
) | st.sampled_from(
    [
        Fault("stuck", "wrench"),
        Fault("delayed", "drill_tool", 0.02),
        Fault("noise", "contact_force", 1.0),
        Fault("off", "nodal_plane"),
    ]
)
TIMES = st.integers(0, 900 * MILLISECOND)


@st.composite
def scenarios(draw):
    planned = []
    for kind in draw(st.lists(FAULTS, max_size=2, unique_by=lambda fault: fault.channel)):
        onset = draw(TIMES)
        length = draw(st.none() | st.integers(1, 300 * MILLISECOND))
        planned.append(ScheduledFault(onset, None if length is None else onset + length, kind))
    return Scenario(0, tuple(planned))


COMMANDS = st.sampled_from([WeightOnBit(0.0), WeightOnBit(25.0), Drive(False, 0.0, 0.0)])
STEPS = st.lists(st.tuples(TIMES, st.none() | COMMANDS | FAULTS), max_size=4)


def serialized(messages):
    """Messages as bytes, so that NaN equals NaN and nothing else what has other bits."""
    return [(time, topic, CODECS[topic].encode(fields)) for time, topic, fields in messages]


def told(values, scenario, steps, advance):
    """Messages of a run under commands and faults, and those of its status."""
    run = Run(Beginning(to_settings(values), 0.3, 5, scenario), Journal())
    run.begin(ORIGIN)
    messages = []
    for number, (time, change) in enumerate(sorted(steps, key=lambda step: step[0])):
        messages += serialized(one_by_one(advance(run, time)))
        messages += serialized([run.status("running", Bookkeeping())])
        if isinstance(change, Fault):
            if all(
                record.fault.channel != change.channel for record in run.simulation.faults.active
            ):
                run.simulation.inject(change, 50 * MILLISECOND * (number % 2))
        elif isinstance(change, WeightOnBit) and values.get("feed_model"):
            run.control.apply(Feed("rate", 1e-4 * change.force))
        elif change is not None:
            run.control.apply(change)
        messages += serialized(run.changes())
    if len(steps) == 2:
        run = run.copy()
    messages += serialized(one_by_one(advance(run, SECOND)))
    messages += serialized([run.status("running", Bookkeeping())])
    return messages + serialized(run.flush("end"))


@settings(max_examples=12)
@given(VALUES, scenarios(), STEPS)
def test_together_they_are_the_same_as_one_by_one(values, scenario, steps):
    if values.get("block_duration", 1.0) * values["telemetry_rate"] < 1.0:
        values = {**values, "block_duration": 1.0}
    expected = told(values, scenario, steps, Run.advance_to)
    assert told(values, scenario, steps, Run.advance_together) == expected


@pytest.mark.parametrize("fault", [Fault("off", "wrench"), Fault("lost_preload", "", 0.5)])
def test_a_fault_that_begins_at_once_is_done_block_by_block(fault):
    scenario = Scenario(0, (ScheduledFault(0, 300 * MILLISECOND, fault),))
    expected = told({}, scenario, [], Run.advance_to)
    assert told({}, scenario, [], Run.advance_together) == expected


def spans(values, *times):
    """Give what a run without changes gives together, up to each time, and the rest."""
    run = Run(Beginning(to_settings(values)), Journal())
    run.begin(ORIGIN)
    return [list(run.advance_together(time)) for time in times]


@pytest.mark.parametrize("model", ["gain", "resonance"])
def test_without_changes_almost_all_come_together(model):
    [found] = spans({"actuator_model": model}, 3 * SECOND)
    assert sum(isinstance(each, Together) for each in found) == 2
    assert len(found) < 10  # the rest are entries of the journal and the faults


def test_a_stop_between_two_blocks_is_made_up_for_block_by_block():
    values = {"telemetry_rate": 100, "block_duration": 0.1}
    _, found = spans(values, 123_456_789, SECOND)
    assert isinstance(found[-1], Together)
    assert found[-1].end == SECOND
    assert len(found[-1].ends) == 80


@given(VALUES.filter(lambda values: values["block_duration"] * values["telemetry_rate"] >= 1))
@settings(max_examples=10)
def test_serialized_by_the_block_they_are_the_same(values):
    [messages] = spans(values, SECOND)
    for found in messages:
        if not isinstance(found, Together):
            continue
        placed = [
            (place, number, int(block.log_times[index]), block.topic, block.message(index))
            for number, (block, places) in enumerate(encoded(found, ENCODERS, "/rpud/"))
            for index, place in enumerate(places.tolist())
        ]
        placed.sort(key=lambda each: each[:2])
        expected = [(t, f"/rpud/{topic}", data) for t, topic, data in serialized(found.messages())]
        assert [each[2:] for each in placed] == expected


@settings(max_examples=15)
@given(
    values=VALUES,
    ends=st.lists(st.integers(1, 300 * MILLISECOND), min_size=1, max_size=30, unique=True),
    scenario=scenarios(),
)
def test_a_span_is_its_blocks(values, ends, scenario):
    configuration = to_settings(values).configuration
    ends = sorted(ends)
    simulation = Simulation(configuration, 0.2, scenario)
    blocks = [simulation.advance_to(end) for end in ends]
    span = Simulation(configuration, 0.2, scenario).advance_through(np.array(ends))
    assert np.diff(span.finished, prepend=0).tolist() == [len(each.segments) for each in blocks]
    assert np.diff(span.struck, prepend=0).tolist() == [len(each.impacts) for each in blocks]
    assert span.impacts.tobytes() == b"".join(each.impacts.tobytes() for each in blocks)
    assert [repr(each) for each in span.readings] == [repr(each.actuator) for each in blocks]
    samples = span.sample_ends()
    for number, each in enumerate(blocks):
        expected = each.sample(Times.from_nanoseconds(each.end))
        for field in dataclasses.fields(samples):
            values = getattr(samples, field.name)[number : number + 1]
            assert values.tobytes() == getattr(expected, field.name).tobytes()
    account = account_of(span)
    assert account.residual == pytest.approx(0.0, abs=1e-6)


def test_an_engine_that_fails_has_not_moved_and_gives_the_same_error():
    seconds, fractions = np.zeros(4, np.int64), np.linspace(0.01, 0.04, 4)
    engines = [Engine(preset("drilling")) for _ in range(2)]
    for engine in engines:
        engine.advance(0, 0.005)
        engine._open_segment["nodal_plane_offset"] = np.inf
    assert engines[0].advance_through(seconds, fractions) is None
    failures = []
    for engine in engines:
        with pytest.raises(EngineError) as failure:
            engine.advance(0, 0.04)
        failures.append(str(failure.value))
    assert failures[0] == failures[1]
