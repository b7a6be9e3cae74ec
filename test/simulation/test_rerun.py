"""A simulation run again from its journal gives the same messages, bit for bit."""

import json
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import to_configuration, to_values
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.journal import Journal, JournalEntry
from rpud_sim.simulation.rerun import JournalError, Rerun
from rpud_sim.simulation.scenario import parse_scenario
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.telemetry import Telemetry

MILLISECOND = 1_000_000
RATES = {"telemetry_rate": 200, "sample_rate": 20_000, "block_duration": 0.02}
SCENARIO = parse_scenario(
    {
        "seed": 7,
        "faults": [
            {"kind": "delayed", "channel": "contact_force", "onset": 0.011, "magnitude": 0.013},
            {"kind": "slow", "channel": "contact_force", "onset": 0.02, "magnitude": 0.005},
            {"kind": "noise", "channel": "wrench", "onset": {"uniform": [0.0, 0.05]}},
            {"kind": "lost_preload", "magnitude": 0.5, "onset": 0.0234567, "duration": 0.02},
        ],
    },
    "scenario",
)


def started(values, journal):
    """Give a simulation with its telemetry, both told to the journal."""
    configuration = to_configuration(values)
    journal.begin({**to_values(configuration), **RATES}, 0.3, 5, SCENARIO)
    simulation = Simulation(configuration, 0.3, SCENARIO, journal)
    telemetry = Telemetry(*RATES.values())
    telemetry.reseed(5)
    journal.note(0, "origin", origin=1_000_000_007)
    telemetry.begin(1_000_000_007)
    return simulation, telemetry


def advance(simulation, telemetry, until, journal):
    """Go on block by block, as the node does, and yield topics with what they say."""
    rate = RATES["telemetry_rate"]
    while simulation.time < until:
        end = boundary(boundaries_until(simulation.time, rate) + 1, rate)
        block = simulation.advance_to(min(end, until))
        if block.end != end:
            journal.note(block.end, "stop")
        yield from telemetry.take(block, simulation.faults.since(block.start))


def act(simulation, number, value):
    """Change the simulation in one of several ways."""
    if number == 0:
        simulation.apply(WeightOnBit(20.0 * value))
    elif number == 1:
        simulation.apply(Drive(value < 0.7, 100.0 * value, 16_000.0 + value))
    elif number == 2:
        changed = {**to_values(simulation.configuration), "actuator_restitution": 0.5 + value / 3}
        changed["regime"] = "free" if value < 0.2 else "drilling"
        simulation.configure(to_configuration(changed))
    elif number == 3:
        simulation.inject(Fault("bias", "nodal_plane", 1e-6 + value), int(value * 1e8))
    else:
        simulation.clear_all()


def again(entries):
    """Give the messages of a rerun, of entries that went through a bag; ground truth aside."""
    rerun = Rerun()
    for entry in entries:
        content = json.loads(entry.text)
        time = content.pop("time")
        read = JournalEntry(entry.sequence, time, entry.kind, content)
        yield from (item for item in rerun.do(read) if item[1] != "faults")


def bits(items):
    """Give messages so that NaN equals NaN, and nothing else what has other bits."""
    return [repr(item) for item in items]


@settings(max_examples=15)
@given(
    regime=st.sampled_from(["free", "drilling"]),
    steps=st.lists(
        st.tuples(
            st.integers(1, 30 * MILLISECOND), st.integers(0, 4), st.floats(0.0, 1.0, width=64)
        ),
        max_size=8,
    ),
)
def test_whatever_was_done_is_done_again(regime, steps):
    journal = Journal()
    simulation, telemetry = started({"regime": regime}, journal)
    given_out = []
    for length, number, value in steps:
        given_out += advance(simulation, telemetry, simulation.time + length, journal)
        with suppress(FaultError):  # it may be there already
            act(simulation, number, value)
    given_out += advance(simulation, telemetry, simulation.time + 31 * MILLISECOND, journal)
    given_out += telemetry.flush()
    journal.note(simulation.time, "end")
    assert bits(again(journal.take())) == bits(given_out)


def test_one_other_bit_in_a_command_gives_another_trajectory():
    journal = Journal()
    simulation, telemetry = started({}, journal)
    simulation.apply(WeightOnBit(20.0))
    given_out = [*advance(simulation, telemetry, 50 * MILLISECOND, journal), *telemetry.flush()]
    journal.note(simulation.time, "end")
    entries = journal.take()
    assert bits(again(entries)) == bits(given_out)
    place = next(i for i, entry in enumerate(entries) if entry.kind == "weight_on_bit")
    entries[place] = JournalEntry(place, 0, "weight_on_bit", {"force": 20.000000000000004})
    assert bits(again(entries)) != bits(given_out)


def test_entries_are_numbered_and_taken_once():
    journal = Journal()
    journal.note(0, "stop")
    journal.note(3, "stop")
    assert [(entry.sequence, entry.time) for entry in journal.take()] == [(0, 0), (1, 3)]
    journal.note(4, "stop")
    assert [entry.sequence for entry in journal.take()] == [2]


def test_a_change_that_is_refused_is_not_noted():
    journal = Journal()
    simulation, _ = started({}, journal)
    simulation.inject(Fault("lost_preload"))
    journal.take()
    with pytest.raises(FaultError):
        simulation.inject(Fault("lost_preload"))
    with pytest.raises(FaultError):
        simulation.clear(99)
    assert journal.take() == []


BEGIN = {"parameters": {**RATES, "regime": "free"}, "initial_phase": 0.0, "seed": 0, "faults": []}


@pytest.mark.parametrize(
    ("kind", "time", "content", "reason"),
    [
        ("explode", 0, {}, "there is no such kind"),
        ("weight_on_bit", 0, {"force": -1.0}, "weight_on_bit = -1 N is outside its range"),
        ("weight_on_bit", 0, {}, "KeyError"),
        ("clear", 0, {"number": 3}, "there is no fault 3"),
        ("begin", 0, {"parameters": {}}, "KeyError"),
        ("begin", 0, {**BEGIN, "parameters": {**RATES, "telemetry_rate": 0}}, "outside its range"),
    ],
)
def test_an_entry_that_cannot_be_done_is_named(kind, time, content, reason):
    rerun = Rerun()
    assert list(rerun.do(JournalEntry(0, 0, "begin", BEGIN))) == []
    with pytest.raises(JournalError, match=rf"^journal entry 1 \({kind}\) cannot be done: .*") as e:
        list(rerun.do(JournalEntry(1, time, kind, content)))
    assert reason in str(e.value)


def test_time_does_not_go_back_and_nothing_comes_before_the_beginning():
    rerun = Rerun()
    with pytest.raises(JournalError, match="nothing has begun"):
        list(rerun.do(JournalEntry(0, 0, "stop", {})))
    list(rerun.do(JournalEntry(0, 0, "begin", BEGIN)))
    list(rerun.do(JournalEntry(1, 5, "stop", {})))
    with pytest.raises(JournalError, match="before that of the one before it"):
        list(rerun.do(JournalEntry(2, 4, "stop", {})))
