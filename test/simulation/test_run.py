"""A run gives the same messages in pieces as in one go, and again from its journal or state."""

import dataclasses
import json
import re
from contextlib import nullcontext, suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rpud_sim.simulation.plans import Scenario, ScheduledFault
from rpud_sim.simulation.rerun import (
    MOST_CHECKPOINTS,
    CheckpointError,
    Checkpoints,
    JournalError,
    Rerun,
)
from support import one_by_one

from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import to_configuration, to_settings, to_values
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.fields import Bookkeeping, stamp_of
from rpud_sim.simulation.journal import Journal, JournalEntry
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.simulation import initial_phases

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
ORIGIN = 1_700_000_000 * SECOND + 7
END = 100 * MILLISECOND
RATES = {"telemetry_rate": 200, "sample_rate": 20_000, "block_duration": 0.02}
STATUS = Path(__file__).parents[2] / "msg_defs" / "msg" / "Status.msg"
SCENARIO = Scenario(
    0,
    (
        ScheduledFault(12_345_678, 40 * MILLISECOND, Fault("lost_preload", "", 0.5)),
        ScheduledFault(20 * MILLISECOND, None, Fault("noise", "wrench")),
    ),
)


def begun(values=None, scenario=None, journal=None, **options):
    """Give a run that has begun, and the messages of its beginning."""
    beginning = Beginning(to_settings({**RATES, **(values or {})}), 0.3, 5, scenario)
    run = Run(beginning, journal, **options)
    run.begin(ORIGIN)
    return run, list(run.changes())


def topics(messages):
    return [topic for _, topic, _ in messages]


def kinds(messages):
    return [fields["kind"] for _, topic, fields in messages if topic == "journal"]


SIGNALS = (
    ScheduledFault(5 * MILLISECOND, 70 * MILLISECOND, Fault("delayed", "nodal_plane", 0.03)),
    ScheduledFault(7_654_321, 80 * MILLISECOND, Fault("intermittent", "contact_force", 0.5)),
    ScheduledFault(30 * MILLISECOND, None, Fault("slow", "drill_tool", 0.025)),
)
ALL_FAULTS = Scenario(0, tuple(sorted((*SCENARIO.faults, *SIGNALS), key=lambda one: one.onset)))


@settings(max_examples=10)
@given(
    regime=st.sampled_from(["free", "drilling"]),
    stops=st.lists(st.integers(1, END - 1), max_size=8),
)
def test_in_pieces_it_gives_the_same_messages_as_in_one_go(regime, stops):
    whole, first = begun({"regime": regime}, ALL_FAULTS)
    expected = [*first, *whole.advance_to(END), *whole.flush()]
    pieces, found = begun({"regime": regime}, ALL_FAULTS)
    for stop in [*sorted(stops), END]:
        found += pieces.advance_to(stop)
    found += pieces.flush()

    def by_topic(messages):
        return {
            topic: [repr(fields) for _, name, fields in messages if name == topic]
            for topic in topics(expected)
            if topic != "faults"
        }

    assert by_topic(found) == by_topic(expected)
    assert pieces.time == whole.time == END


def test_the_beginning_comes_first_then_the_origin_and_another_place_changes_stamps():
    run, messages = begun(journal=Journal())
    assert topics(messages) == ["journal", "journal", "faults"]
    assert kinds(messages) == ["begin", "origin"]
    assert stamp_of(messages[-1][2]) == ORIGIN
    assert list(run.changes()) == []
    list(run.advance_to(10 * MILLISECOND))
    run.place(5)
    messages = list(run.changes())
    assert (run.origin, run.time) == (5, 10 * MILLISECOND)
    assert topics(messages) == ["journal", "faults"]
    assert kinds(messages) == ["origin"]
    stamps = {stamp_of(fields) for _, _, fields in run.advance_to(15 * MILLISECOND)}
    assert max(stamps) == 5 + 15 * MILLISECOND


def test_an_entry_comes_before_its_consequences():
    run, _ = begun(journal=Journal())
    list(run.advance_to(10 * MILLISECOND))
    run.control.apply(WeightOnBit(30.0))
    run.simulation.inject(Fault("free_mass_jammed"))
    messages = list(run.advance_to(20 * MILLISECOND))
    assert topics(messages)[:3] == ["journal", "journal", "faults"]
    assert kinds(messages) == ["weight_on_bit", "inject"]
    assert all(time == 10 * MILLISECOND for time, _, _ in messages[:3])
    assert [stamp_of(fields) for _, _, fields in messages[:3]] == [ORIGIN + 10 * MILLISECOND] * 3


@pytest.mark.parametrize("kind", ["flush", "end"])
def test_stops_inside_a_block_and_a_flush_are_entries_before_their_messages(kind):
    run, found = begun(journal=Journal())
    for stop, expected in ((10, []), (12, ["stop"]), (15, []), (27, ["stop"])):
        messages = list(run.advance_to(stop * MILLISECOND))
        assert kinds(messages) == expected
        found += messages
    rest, again = list(run.flush(kind)), list(run.flush(kind))
    assert kinds(rest) == [kind]
    assert topics(rest) == ["journal", "waveform", "trajectory"]
    assert topics(again) == ["journal"]
    entries = [fields for _, topic, fields in (*found, *rest, *again) if topic == "journal"]
    assert [fields["sequence"] for fields in entries] == list(range(len(entries)))


def test_a_stop_inside_a_block_comes_before_the_impacts_of_the_block():
    run, _ = begun({"regime": "free"}, journal=Journal())
    list(run.advance_to(10 * MILLISECOND))
    assert topics(run.advance_to(14 * MILLISECOND))[:2] == ["journal", "contact_force"]


def test_faults_are_published_once_for_each_change():
    run, messages = begun(scenario=SCENARIO)
    messages += run.advance_to(END)
    published = [
        (time // MILLISECOND, [fault["kind"] for fault in fields["faults"] if fault["active"]])
        for time, topic, fields in messages
        if topic == "faults"
    ]
    # Faults change at their instants, and are published at the end of the block.
    assert published == [
        (0, []),
        (15, ["lost_preload"]),
        (20, ["lost_preload", "noise"]),
        (40, ["noise"]),
    ]
    last = next(fields for _, topic, fields in reversed(messages) if topic == "faults")
    onsets = [fault["onset"]["nanosec"] for fault in last["faults"]]
    assert onsets == [12_345_685, 20 * MILLISECOND + 7]


def test_the_status_gives_every_field_of_its_message():
    declared = re.findall(r"^[\w/]+ +([a-z]\w*) *(?:#.*)?$", STATUS.read_text(), re.MULTILINE)
    assert len(declared) > 25
    run, _ = begun()
    list(run.advance_to(10 * MILLISECOND))
    time, topic, fields = run.status("running", Bookkeeping(commands_accepted=3, lag=0.25))
    assert {*fields} == {*declared}
    assert (time, topic) == (10 * MILLISECOND, "status")
    assert stamp_of(fields) == ORIGIN + 10 * MILLISECOND
    assert (fields["state"], fields["commands_accepted"], fields["lag"]) == ("running", 3, 0.25)
    assert fields["impacts"] == run.simulation.impact_count > 0


def test_while_inactive_nothing_acts_and_the_first_block_shows_it():
    run, messages = begun(active=False, journal=Journal())
    assert kinds(messages) == ["begin", "weight_on_bit", "drive", "origin"]
    applied = run.simulation.applied
    assert applied.weight_on_bit.force == 0.0
    assert not applied.drive.enabled
    run.control.apply(WeightOnBit(30.0))
    assert run.simulation.applied == applied
    run.control.activate(True)
    assert run.simulation.applied.weight_on_bit.force == 8.0
    assert run.simulation.applied.drive.enabled


def test_other_settings_reach_the_watchdog_and_the_drill():
    run, _ = begun({"command_timeout": 0.0})
    run.configure(run.beginning.settings.replace({"command_timeout": 0.01, "gravity": 1.62}))
    list(run.advance_to(20 * MILLISECOND))
    assert run.control.act()
    assert run.control.commands_lost
    assert run.simulation.parameters.gravity == 1.62


@given(
    st.integers(1, 2**32 - 1),
    st.dictionaries(st.sampled_from(["weight_on_bit", "gravity"]), st.floats(0.1, 9.0)),
)
def test_a_beginning_is_read_back_from_its_journal(seed, values):
    drawn = Beginning.drawn(to_settings({**RATES, **values}), seed)
    beginning = dataclasses.replace(drawn, scenario=Scenario(seed, SCENARIO.faults))
    content = json.loads(json.dumps(beginning.to_journal()))
    assert Beginning.from_journal(content) == beginning


def test_the_seed_of_the_settings_holds_unless_another_is_given():
    settings = to_settings({"seed": 4})
    assert Beginning.drawn(settings) == Beginning.drawn(settings, 4)
    assert Beginning.drawn(settings, 9) == Beginning(settings, initial_phases(1, 9)[0], 9)
    assert Beginning.drawn(to_settings({})).initial_phase == 0.0


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
    run.begin(ORIGIN)
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
    run, messages = started({**RATES, "regime": regime}, ALL_FAULTS), []
    for length, number, value in steps:
        messages += run.advance_to(run.time + length)
        with suppress(FaultError):  # it may be there already
            act(run.simulation, number, value)
    messages += [*run.advance_to(run.time + 31 * MILLISECOND), *run.flush("end")]
    told, entries = split(messages)
    assert again(entries)[1] == told


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
