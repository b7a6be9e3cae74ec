"""A simulation run again from its journal gives the same messages, bit for bit."""

import json
from contextlib import nullcontext, suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import to_configuration, to_settings, to_values
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.journal import Journal, JournalEntry
from rpud_sim.simulation.rerun import (
    MOST_CHECKPOINTS,
    CheckpointError,
    Checkpoints,
    JournalError,
    Rerun,
)
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
DRILLS = {
    "drilling": {},
    "free": {"regime": "free"},
    "resonance": {"actuator_model": "resonance", "rock_model": "specific_energy"},
    "tracking": {"actuator_model": "resonance", "generator": "tracking"},
    "rotation": {"rotation_model": "friction_drive", "rock_model": "specific_energy"},
    "arm": {"feed_model": "arm", "strata": "regolith", "rotation_model": "friction_drive"},
}


def started(values, scenario=None):
    run = Run(Beginning(to_settings(values), 0.3, 5, scenario), Journal())
    run.begin(1_000_000_007)
    return run


def to_entry(message):
    """Return the entry of a message as a bag's reader has it."""
    _, _, fields = message
    content = json.loads(fields["content"])
    return JournalEntry(fields["sequence"], content.pop("time"), fields["kind"], content)


def split(messages):
    """Give texts in which NaN equals NaN, of messages but journal and faults, and the entries."""
    messages = list(one_by_one(messages))
    told = [repr(each) for each in messages if each[1] not in ("journal", "faults")]
    return told, [to_entry(each) for each in messages if each[1] == "journal"]


def again(entries):
    """Give a rerun of entries that went through a bag, and its messages."""
    rerun = Rerun()
    return rerun, split(message for entry in entries for message in rerun.repeat(entry))[0]


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


LENGTHS = st.integers(1, 30 * MILLISECOND)


@settings(max_examples=15)
@given(
    regime=st.sampled_from(["free", "drilling"]),
    steps=st.lists(st.tuples(LENGTHS, st.integers(0, 4), st.floats(0.0, 1.0)), max_size=8),
)
def test_whatever_was_done_is_done_again(regime, steps):
    run, messages = started({**RATES, "regime": regime}, SCENARIO), []
    for length, number, value in steps:
        messages += run.advance_to(run.time + length)
        with suppress(FaultError):  # it may be there already
            act(run.simulation, number, value)
    messages += [*run.advance_to(run.time + 31 * MILLISECOND), *run.flush("end")]
    told, entries = split(messages)
    assert again(entries)[1] == told


def test_one_other_bit_in_a_command_gives_another_trajectory():
    run = started(RATES)
    run.simulation.apply(WeightOnBit(20.0))
    told, entries = split([*run.advance_to(50 * MILLISECOND), *run.flush("end")])
    assert again(entries)[1] == told
    place = [entry.kind for entry in entries].index("weight_on_bit")
    entries[place] = JournalEntry(place, 0, "weight_on_bit", {"force": 20.000000000000004})
    assert again(entries)[1] != told


def test_a_change_that_is_refused_is_not_noted():
    run = started(RATES)
    run.simulation.inject(Fault("lost_preload"))
    list(run.changes())
    with pytest.raises(FaultError):
        run.simulation.inject(Fault("lost_preload"))
    with pytest.raises(FaultError):
        run.simulation.clear(99)
    assert list(run.changes()) == []


BEGIN = {"parameters": {**RATES, "regime": "free"}, "initial_phase": 0.0, "seed": 0, "faults": []}


@pytest.mark.parametrize(
    ("kind", "time", "content", "reason"),
    [
        ("explode", 5, {}, "there is no such kind"),
        ("stop", 4, {}, "before that of the one before it"),
        ("weight_on_bit", 5, {"force": -1.0}, "weight_on_bit = -1 N is outside its range"),
        ("weight_on_bit", 5, {}, "KeyError"),
        ("clear", 5, {"number": 3}, "there is no fault 3"),
        ("begin", 0, {"parameters": {}}, "KeyError"),
        ("begin", 0, {**BEGIN, "parameters": {**RATES, "telemetry_rate": 0}}, "outside its range"),
    ],
)
def test_an_entry_that_cannot_be_done_is_named(kind, time, content, reason):
    rerun, _ = again([JournalEntry(0, 0, "begin", BEGIN), JournalEntry(1, 5, "stop", {})])
    with pytest.raises(JournalError, match=rf"^journal entry 2 \({kind}\) cannot be done: .*") as e:
        list(rerun.repeat(JournalEntry(2, time, kind, content)))
    assert reason in str(e.value)
    with pytest.raises(JournalError, match="nothing has begun"):
        again([JournalEntry(0, 0, "stop", {})])


def go_on(run):
    """Go on and change something; return all messages as texts."""
    messages = list(run.advance_to(run.time + 15 * MILLISECOND))
    fed = run.simulation.configuration.has_feed
    run.control.apply(Feed("rate", -1e-3) if fed else WeightOnBit(17.0))
    return split([*messages, *run.advance_to(run.time + 33 * MILLISECOND)])[0]


@settings(max_examples=8)
@given(
    time=st.integers(0, 50 * MILLISECOND),
    values=st.sampled_from([DRILLS[name] for name in ("drilling", "tracking", "arm")]),
)
def test_copies_and_checkpoints_go_on_like_their_run_and_by_themselves(time, values):
    run, checkpoints = started(values), Checkpoints()
    for kind in ("noise", "intermittent", "garbage", "delayed"):
        run.simulation.inject(Fault(kind, "contact_force"), 40 * MILLISECOND)
    list(run.advance_to(time))
    checkpoints.save("here", run)
    copies = [run.copy(Journal()), run.copy(Journal())]
    expected = go_on(run)
    assert all(go_on(each) == expected for each in copies)
    found = checkpoints.find("here")
    assert found.time == time
    first = go_on(found)
    assert go_on(checkpoints.find("here")) == first
    assert checkpoints.names == ("here",)


def test_names_and_number_of_checkpoints_are_checked():
    run, checkpoints = started({}), Checkpoints()

    def refused(reason):
        return pytest.raises(CheckpointError, match=reason) if reason else nullcontext()

    with refused("no checkpoint 'a'; none was saved"):
        checkpoints.find("a")
    names = [f"rock{number}" for number in range(MOST_CHECKPOINTS)]
    for name, reason in (
        *((each, "is no name of a checkpoint") for each in ("", "a b", "x" * 65, "a/b", "a\n")),
        *((each, "") for each in names),
        ("more", "one more than 16 checkpoints: .* such as rock0"),
        ("rock0", ""),
    ):
        with refused(reason):
            checkpoints.save(name, run)
    assert checkpoints.names == (*names[1:], "rock0")
    with refused(r"'roc0'; did you mean rock0\?"):
        checkpoints.find("roc0")


@pytest.mark.parametrize("faulty", [False, True])
@pytest.mark.parametrize("name", DRILLS)
def test_a_run_goes_on_from_its_state_with_the_same_bits(name, faulty):
    run = Run(Beginning.drawn(to_settings(DRILLS[name])), Journal())
    run.begin(5)
    messages = list(run.advance_to(330 * MILLISECOND))
    for kind in KINDS if faulty else ():
        for channel in ("",) if KINDS[kind].physical else ("wrench", "contact_force"):
            with suppress(FaultError):  # not of this drill
                run.simulation.inject(Fault(kind, channel), 400 * MILLISECOND)
    run.control.apply(Feed("rate", 1e-4) if name == "arm" else WeightOnBit(11.0))
    messages += run.advance_to(371 * MILLISECOND)
    run.note_state()
    _, entries = split([*messages, *run.changes()])
    text = json.dumps(run.state(), sort_keys=True)
    began, told = again(entries[-1:])
    assert told == []
    for rerun in (began, again(entries)[0]):
        assert json.dumps(rerun.run.state(), sort_keys=True) == text
    end = 900 * MILLISECOND
    assert split(began.advance_to(end))[0] == split(run.advance_to(end))[0]
