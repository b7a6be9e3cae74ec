"""A simulation run again from its journal gives the same messages, bit for bit."""

import itertools
import json
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import to_configuration, to_settings, to_values
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.journal import Journal, JournalEntry
from rpud_sim.simulation.rerun import JournalError, Rerun
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.scenario import parse_scenario
from rpud_sim.simulation.telemetry import one_by_one

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
    """Give a run that has begun, with its journal."""
    run = Run(Beginning(to_settings({**values, **RATES}), 0.3, 5, SCENARIO), journal)
    run.begin(1_000_000_007)
    return run


def heard(messages, entries):
    """Give messages but those of the journal, whose entries are kept, and of the ground truth."""
    for time, topic, values in messages:
        if topic == "journal":
            content = json.loads(values["content"])
            entries.append(
                JournalEntry(values["sequence"], content.pop("time"), values["kind"], content)
            )
        elif topic != "faults":
            yield time, topic, values


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
        messages = one_by_one(rerun.repeat(entry))
        yield from (item for item in messages if item[1] != "faults")


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
    run, entries, given_out = started({"regime": regime}, Journal()), [], []
    for length, number, value in steps:
        given_out += heard(run.advance_to(run.time + length), entries)
        with suppress(FaultError):  # it may be there already
            act(run.simulation, number, value)
    given_out += heard(run.advance_to(run.time + 31 * MILLISECOND), entries)
    given_out += heard(run.flush("end"), entries)
    assert bits(again(entries)) == bits(given_out)


def test_one_other_bit_in_a_command_gives_another_trajectory():
    run, entries = started({}, Journal()), []
    run.simulation.apply(WeightOnBit(20.0))
    messages = itertools.chain(run.advance_to(50 * MILLISECOND), run.flush("end"))
    given_out = list(heard(messages, entries))
    assert bits(again(entries)) == bits(given_out)
    place = next(i for i, entry in enumerate(entries) if entry.kind == "weight_on_bit")
    entries[place] = JournalEntry(place, 0, "weight_on_bit", {"force": 20.000000000000004})
    assert bits(again(entries)) != bits(given_out)


def test_a_change_that_is_refused_is_not_noted():
    journal = Journal()
    simulation = started({}, journal).simulation
    simulation.inject(Fault("lost_preload"))
    journal.drain()
    with pytest.raises(FaultError):
        simulation.inject(Fault("lost_preload"))
    with pytest.raises(FaultError):
        simulation.clear(99)
    assert journal.drain() == []


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
    assert list(rerun.repeat(JournalEntry(0, 0, "begin", BEGIN))) == []
    with pytest.raises(JournalError, match=rf"^journal entry 1 \({kind}\) cannot be done: .*") as e:
        list(rerun.repeat(JournalEntry(1, time, kind, content)))
    assert reason in str(e.value)


def test_time_does_not_go_back_and_nothing_comes_before_the_beginning():
    rerun = Rerun()
    with pytest.raises(JournalError, match="nothing has begun"):
        list(rerun.repeat(JournalEntry(0, 0, "stop", {})))
    list(rerun.repeat(JournalEntry(0, 0, "begin", BEGIN)))
    list(rerun.repeat(JournalEntry(1, 5, "stop", {})))
    with pytest.raises(JournalError, match="before that of the one before it"):
        list(rerun.repeat(JournalEntry(2, 4, "stop", {})))
