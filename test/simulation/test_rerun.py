"""A simulation run again from its journal gives the same messages, bit for bit."""

import itertools
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


def started(values, journal):
    """Give a run that has begun, with its journal."""
    run = Run(Beginning(to_settings({**values, **RATES}), 0.3, 5, SCENARIO), journal)
    run.begin(1_000_000_007)
    return run


def to_entry(message):
    """Return the entry of a message as a bag's reader has it."""
    _, _, fields = message
    content = json.loads(fields["content"])
    return JournalEntry(fields["sequence"], content.pop("time"), fields["kind"], content)


def heard(messages, entries):
    """Give messages but those of the journal, whose entries are kept, and of the ground truth."""
    for message in messages:
        if message[1] == "journal":
            entries.append(to_entry(message))
        elif message[1] != "faults":
            yield message


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
    for sequence, time, kind, reason in (
        (0, 0, "stop", "nothing has begun"),
        (0, 0, "begin", ""),
        (1, 5, "stop", ""),
        (2, 4, "stop", "before that of the one before it"),
    ):
        entry = JournalEntry(sequence, time, kind, BEGIN if kind == "begin" else {})
        with pytest.raises(JournalError, match=reason) if reason else nullcontext():
            list(rerun.repeat(entry))


RESONANCE = {
    "actuator_model": "resonance",
    "generator": "tracking",
    "rock_model": "specific_energy",
}


FED = {
    "feed_model": "arm",
    "initial_feed": 0.004,
    "rock_model": "specific_energy",
    "rotation_model": "friction_drive",
}


def launched(values):
    run = Run(Beginning(to_settings(values), 0.3, 5), Journal())
    run.begin(7)
    for kind in ("noise", "intermittent", "garbage", "delayed"):
        run.simulation.inject(Fault(kind, "contact_force"), 40 * MILLISECOND)
    return run


def go_on(run):
    """Go on and change something; return all messages as texts, in which NaN equals NaN."""
    messages = list(run.advance_to(run.time + 15 * MILLISECOND))
    fed = run.simulation.configuration.has_feed
    run.control.apply(Feed("rate", -1e-3) if fed else WeightOnBit(17.0))
    messages += run.advance_to(run.time + 33 * MILLISECOND)
    return [repr(message) for message in messages if message[1] != "journal"]


@settings(max_examples=8)
@given(time=st.integers(0, 50 * MILLISECOND), values=st.sampled_from([{}, RESONANCE, FED]))
def test_a_copy_goes_on_like_its_run_and_by_itself(time, values):
    run = launched(values)
    list(run.advance_to(time))
    first, second = run.copy(Journal()), run.copy(Journal())
    found = go_on(first)
    assert run.time == time
    assert go_on(second) == found
    assert go_on(run) == found


def test_a_checkpoint_stays_as_it_was_saved():
    run, checkpoints = launched({}), Checkpoints()
    list(run.advance_to(11 * MILLISECOND))
    checkpoints.save("here", run)
    found = go_on(checkpoints.find("here"))
    assert go_on(checkpoints.find("here")) == found
    assert checkpoints.names == ("here",)


def test_names_and_number_of_checkpoints_are_checked():
    run, checkpoints = launched({}), Checkpoints()
    with pytest.raises(CheckpointError, match="no checkpoint 'a'; none was saved"):
        checkpoints.find("a")
    for name in ("", "a b", "x" * 65, "a/b", "a\n"):
        with pytest.raises(CheckpointError, match="is no name of a checkpoint"):
            checkpoints.save(name, run)
    for number in range(MOST_CHECKPOINTS):
        checkpoints.save(f"rock{number}", run)
    with pytest.raises(CheckpointError, match=r"'roc0'; did you mean rock0\?"):
        checkpoints.find("roc0")
    with pytest.raises(CheckpointError, match=r"one more than 16 checkpoints: .* such as rock0"):
        checkpoints.save("more", run)
    checkpoints.save("rock0", run)
    assert checkpoints.names[-1] == "rock0"


DRILLS = {
    "drilling": {},
    "free": {"regime": "free"},
    "resonance": {"actuator_model": "resonance", "rock_model": "specific_energy"},
    "tracking": {"actuator_model": "resonance", "generator": "tracking"},
    "rotation": {"rotation_model": "friction_drive", "rock_model": "specific_energy"},
    "arm": {"feed_model": "arm", "strata": "regolith", "rotation_model": "friction_drive"},
}


def every_fault(run):
    """Inject each fault that the drill can have, on two channels where it acts on one."""
    for name, kind in KINDS.items():
        for channel in ("",) if kind.physical else ("wrench", "contact_force"):
            try:
                run.simulation.inject(Fault(name, channel), 400 * MILLISECOND)
            except FaultError:
                continue


@pytest.mark.parametrize("faulty", [False, True])
@pytest.mark.parametrize("name", DRILLS)
def test_a_run_goes_on_from_its_state_with_the_same_bits(name, faulty):
    run = Run(Beginning.drawn(to_settings(DRILLS[name])), Journal())
    run.begin(5)
    entries = [each for each in run.advance_to(330 * MILLISECOND) if each[1] == "journal"]
    if faulty:
        every_fault(run)
    run.control.apply(Feed("rate", 1e-4) if name == "arm" else WeightOnBit(11.0))
    entries += [each for each in run.advance_to(371 * MILLISECOND) if each[1] == "journal"]
    run.note_state()
    last = [each for each in run.changes() if each[1] == "journal"]
    own = to_entry(last[-1])
    text = json.dumps(run.state(), sort_keys=True)

    began = Rerun()
    assert list(began.repeat(own)) == []
    assert json.dumps(began.run.state(), sort_keys=True) == text
    repeated = Rerun()
    for entry in (*entries, *last):
        for _ in repeated.repeat(to_entry(entry)):
            pass
    assert json.dumps(repeated.run.state(), sort_keys=True) == text

    end = 900 * MILLISECOND
    expected = repr([each for each in run.advance_to(end) if each[1] != "journal"])
    assert repr(list(one_by_one(began.advance_to(end)))) == expected
