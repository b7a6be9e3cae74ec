"""What has been history of a drill, from messages as they come, and what is drawn of it."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from rpud_msgs.msg import (
    CommandResult,
    CommandResults,
    Fault,
    Faults,
    JournalEntry,
    Status,
    Waveform,
)

from rpud_sim.messages.batch import Batch
from rpud_sim.ros.graph import message_class
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.frames import ClientState, measured
from rpud_sim.viewer.live_history import BIN, LiveHistory

SECOND = 1_000_000_000
ORIGIN = 1_700_000_000 * SECOND + 123
PARAMETERS = {
    "weight_on_bit": 8.0,
    "drive_enabled": True,
    "nominal_voltage": 100.0,
    "vibration_frequency": 16e3,
}


def stamp(nanoseconds):
    return Time(sec=nanoseconds // SECOND, nanosec=nanoseconds % SECOND)


def entry(number, kind, time, origin=ORIGIN, **content):
    message = JournalEntry(
        sequence=number, kind=kind, content=json.dumps({"time": time, **content})
    )
    message.header.stamp = stamp(origin + time)
    return message


def status(time, **fields):
    message = Status(**fields)
    message.header.stamp = stamp(ORIGIN + time)
    message.weight_on_bit_applied = message.drive_applied = stamp(ORIGIN)
    return message


def rejection(time, reason):
    result = CommandResult(kind="drive", accepted=False, reason=reason)
    message = CommandResults(results=[result], repeated=0)
    message.header.stamp = stamp(ORIGIN + time)
    return message


@pytest.fixture
def history():
    history = LiveHistory()
    tell(history, "journal", entry(0, "begin", 0, parameters=PARAMETERS))
    return history


def batch(topic, *rows):
    """Return messages as they arrive: rows are a time since ``ORIGIN`` [ns] and fields.

    They are published then, or at ``published``.
    """
    found = []
    for time, fields in rows:
        published = fields.get("published", time)
        kept = {name: value for name, value in fields.items() if name != "published"}
        message = message_class(TOPICS[topic].type)(**kept)
        message.header.stamp = stamp(ORIGIN + time)
        found.append((bytes(serialize_message(message)), published, published))
    return Batch.of_bytes(topic, found)


def waveform(period, count):
    """Return fields of a message of the waveform, each of whose channels is constant."""
    _, _, _, *channels = Waveform.get_fields_and_field_types()
    values = {name: [float(number)] * count for number, name in enumerate(channels)}
    return {"sample_period": period, **values}


def hear(history, topic, time, **fields):
    history.settle([batch(topic, (time, fields))])


def tell(history, topic, message, published=0):
    history.latched(topic, message, published)
    history.settle()


def impact(history, time, force):
    hear(history, "contact_force", time, peak_force=force, contact_duration=1e-5)


def texts(history):
    return [line["text"] for line in history.commands.frame(history.faults)["log"]]


def test_status_and_faults_before_the_journal_are_shown_as_soon_as_it_comes():
    history = LiveHistory()
    tell(history, "status", status(SECOND, state="paused"))
    fault = Fault(number=1, kind="bias", active=True, onset=stamp(ORIGIN + SECOND // 2))
    faults = Faults(faults=[fault])
    faults.header.stamp = stamp(ORIGIN + SECOND)
    tell(history, "faults", faults)
    assert not history.reports
    tell(history, "journal", entry(0, "begin", 0, parameters=PARAMETERS))
    assert (history.time, history.reports["status"]["state"]) == (1.0, "paused")
    assert history.reports["status"]["weight_on_bit_applied"] == 0.0
    [shown] = history.faults
    assert (shown["kind"], shown["onset"], shown["end"]) == ("bias", 0.5, None)


@pytest.mark.parametrize("reset", [0, 3 * SECOND])  # the stamp: the clock begins again, or goes on
def test_a_fault_is_shown_to_who_joins_after_a_reset(reset):
    history = LiveHistory()
    faults = Faults(faults=[Fault(number=1, kind="bias", active=True, onset=stamp(ORIGIN + reset))])
    faults.header.stamp = stamp(ORIGIN + 4 * SECOND)
    tell(history, "faults", faults)
    begins = [entry(number, "begin", 0, parameters=PARAMETERS) for number in range(2)]
    begins[1].header.stamp = stamp(ORIGIN + reset)
    for begin in begins:
        tell(history, "journal", begin)
    [shown] = history.faults
    assert (shown["kind"], shown["onset"]) == ("bias", 0.0)


def test_all_quantities_of_the_whole_run_are_kept(history):
    rows = ((0, 5.0), (SECOND // 25, 9.0), (SECOND // 20, 7.0), (3 * SECOND, 1.0))
    forces = batch("reacting_force", *((time, {"force": force}) for time, force in rows))
    peaks = batch("contact_force", *((time, {"peak_force": force}) for time, force in rows))
    history.settle([forces, peaks])
    for found in history.bins:
        seen = found.view("reacting_force force", 0.0, 2 * BIN, 2)
        assert seen["low"][:2].tolist() == [5.0, 7.0]
        assert seen["high"][:2].tolist() == [9.0, 7.0]
    assert history.impacts.between(0.0, 4.0)[1].tolist() == [5.0, 9.0, 7.0, 1.0]
    assert history.values["contact_force"]["peak_force"] == 1.0
    assert history.since == 0.0


@pytest.fixture
def frame(history, monkeypatch):
    """Frames of one browser, each some time after the one before [s]."""
    now, client = [0.0], ClientState()
    clock = SimpleNamespace(monotonic=lambda: now[0], thread_time=lambda: now[0])
    monkeypatch.setattr("rpud_sim.viewer.frames.time", clock)

    def make(passed=10.0, *, section=False):
        now[0] += passed
        history.settle()
        client.section = section
        return measured(history, client)

    return make


def test_what_arrives_late_is_in_the_numbers_and_the_timeline(history, frame):
    impact(history, 1 * SECOND, 100.0)
    tell(history, "status", status(3 * SECOND))
    assert frame()["numbers"]["impact_rate"]["mean"] == 0.0
    impact(history, 5 * SECOND // 2, 300.0)
    shown = frame()
    assert shown["numbers"]["impact_rate"]["mean"] == 1.0
    assert np.nanmax(shown["timeline"]["high"]) == 300.0
    impact(history, 2 * SECOND, 900.0)
    assert np.nanmax(frame()["timeline"]["high"]) == 900.0
    assert "numbers" not in frame()


def test_a_command_that_is_heard_before_its_time_is_a_step(history, frame):
    tell(history, "status", status(SECOND))
    frame()
    tell(history, "journal", entry(1, "weight_on_bit", 2 * SECOND, force=20.0))
    assert frame()["steps"]["weight_on_bit"]["v"].tolist() == [8.0, 20.0]


def test_an_impact_that_is_heard_after_its_block_is_in_the_section(history, frame):
    hear(history, "reacting_force", 0, force=1.0)
    hear(history, "waveform", SECOND, **waveform(1e-4, 200))
    assert frame(section=True)["section"]["impacts"] == []
    assert "section" not in frame(section=True)
    impact(history, SECOND + SECOND // 100, 300.0)
    [[time, *_]] = frame(section=True)["section"]["impacts"]
    assert time == pytest.approx(0.01)


def test_a_block_of_the_waveform_is_shown_when_its_impacts_had_time_to_arrive(history):
    block = waveform(1e-3, 100)
    hear(history, "reacting_force", SECOND // 2, force=7.0)
    hear(history, "waveform", SECOND // 2, **block)
    history.settle()
    assert history.block is None  # other topics may not be history yet
    hear(history, "waveform", SECOND, **block)
    assert history.block is None
    history.settle()
    begin, period, arrays = history.block
    assert (begin, period) == (1.0, 1e-3)
    assert [each.tolist() for each in arrays] == [*block.values()][1:]


def test_a_reset_begins_a_new_run_with_nothing(history):
    impact(history, 0, 5.0)
    tell(history, "journal", entry(1, "weight_on_bit", SECOND, force=3.0))
    assert texts(history) == ["a run begins", "weight on bit 3 N"]
    tell(history, "journal", entry(2, "begin", 0, parameters=PARAMETERS))
    assert (history.run, history.impacts.total, history.values) == (2, 0, {})
    assert texts(history) == ["a run begins"]


def test_what_was_published_before_a_reset_is_of_the_run_before(history):
    """The stamps go back, as after a long step, and no order holds among topics."""
    tell(history, "status", status(5 * SECOND, state="running"), 90)
    rows = ((5 * SECOND, 5.0, 91), (SECOND // 10, 7.0, 101), (4 * SECOND, 6.0, 99))
    forces = [(time, {"force": force, "published": sent}) for time, force, sent in rows]
    tell(history, "journal", entry(1, "begin", 0, parameters=PARAMETERS), 100)
    assert (history.time, history.reports) == (None, {})
    tell(history, "status", status(4 * SECOND, state="running"), 98)
    history.settle([batch("reacting_force", *forces)])
    assert (history.time, history.values["reacting_force"]["force"]) == (0.1, 7.0)
    tell(history, "status", status(SECOND, state="paused"), 102)
    assert (history.time, history.reports["status"]["state"]) == (1.0, "paused")


def test_stamps_that_begin_anew_move_nothing_of_the_same_run(history):
    """A pause of 60 s is over; the status with a new stamp comes before the journal says so."""
    forces = batch("reacting_force", (1 * SECOND, {"force": 5.0}), (1_100_000_000, {"force": 6.0}))
    pause, over = 60 * SECOND, 61_200_000_000
    tell(history, "status", status(over), over)
    origin = entry(1, "origin", 1_200_000_000, ORIGIN + pause)
    tell(history, "journal", origin, over)
    history.settle([forces])
    hear(history, "reacting_force", 1_300_000_000 + pause, force=7.0)
    assert history.time == 1.3
    bins = history.bins[0].view("reacting_force force", 0.0, 100.0, 10_000)
    used = bins["mean"] > 0.0
    assert [*zip(bins["t"][used].round(3), bins["mean"][used], strict=True)] == [
        (1.025, 5.0),
        (1.125, 6.0),
        (1.325, 7.0),
    ]


def test_a_fault_of_before_a_pause_is_at_its_time_for_who_joins_after_it():
    """The lists of faults that follow the pause have its origin; rejections do not."""
    history, pause = LiveHistory(), 60 * SECOND
    history.latched("command_results", rejection(2 * SECOND, "old"), 2 * SECOND)
    faults = Faults(faults=[Fault(number=1, kind="bias", active=True)])
    faults.header.stamp = stamp(ORIGIN + 3 * SECOND + pause)
    faults.faults[0].onset = stamp(ORIGIN + SECOND + pause)
    history.latched("faults", faults, 3 * SECOND + pause)
    history.latched("journal", entry(2, "flush", 4 * SECOND, ORIGIN + pause), 4 * SECOND + pause)
    begin = entry(0, "begin", 0, parameters=PARAMETERS)
    history.complete([begin, entry(1, "origin", 3 * SECOND, ORIGIN + pause)])
    history.release()
    history.settle()
    assert [fault["onset"] for fault in history.faults] == [1.0]
    assert not [each for each in history.log()["log"] if each["kind"] == "refusal"]


def test_a_drill_that_is_gone_stays_until_another_begins(history):
    impact(history, SECOND, 5.0)
    history.restart()
    impact(history, 9 * SECOND, 6.0)  # of the next one, before its journal
    assert history.impacts.between(0.0, 20.0)[0].tolist() == [1.0]
    tell(history, "journal", entry(0, "begin", 0, parameters=PARAMETERS))
    assert (history.run, history.impacts.total) == (2, 0)


def test_a_late_screen_holds_entries_until_it_has_those_before():
    history = LiveHistory()
    tell(history, "journal", entry(5, "weight_on_bit", 2 * SECOND, force=3.0))
    assert (history.run, len(history.held)) == (0, 1)
    history.complete([entry(0, "begin", 0, parameters=PARAMETERS)])
    history.release()
    assert texts(history) == ["a run begins", "weight on bit 3 N"]
    tell(history, "journal", entry(6, "weight_on_bit", 3 * SECOND, force=4.0))
    assert texts(history)[-1] == "weight on bit 4 N"


@pytest.mark.parametrize(("kept", "shown"), [(True, "{layers: []}"), (False, {"same_as_entry": 3})])
def test_a_late_screen_has_the_strata_of_an_earlier_run_or_shows_which_they_are(kept, shown):
    history = LiveHistory()
    begin = entry(9, "begin", 0, parameters={**PARAMETERS, "strata": {"same_as_entry": 3}})
    for message in (entry(8, "flush", 2 * SECOND), begin):
        tell(history, "journal", message)
    assert history.needed == 3
    if kept:
        first = entry(3, "begin", 0, parameters={**PARAMETERS, "strata": "{layers: []}"})
        history.complete([first, *(entry(number, "flush", SECOND) for number in range(4, 8))])
    history.release()
    assert history.commands.parameters["strata"] == shown
    assert history.journal_lost == 0


def test_a_jump_in_the_journal_is_counted_as_lost(history):
    tell(history, "journal", entry(4, "flush", SECOND))
    assert history.journal_lost == 3


@pytest.mark.parametrize(
    "content", ["", "[" * 99999, "[]", '{"time": "now"}', f'{{"time": {10**30}}}']
)
def test_what_another_program_writes_into_the_journal_changes_nothing(history, content):
    tell(history, "journal", JournalEntry(sequence=1, kind="begin", content=content))
    assert history.run == 1


def test_refusals_stand_at_their_time_and_not_in_the_run_after_them():
    history = LiveHistory()
    tell(history, "command_results", rejection(7 * SECOND, "old"), 90)
    tell(history, "journal", entry(0, "begin", 0, parameters=PARAMETERS), 100)
    tell(history, "command_results", rejection(2 * SECOND, "new"), 110)
    log = history.log()["log"]
    assert [(line["time"], line["text"]) for line in log] == [
        (0.0, "a run begins"),
        (2.0, "rejected: new"),
    ]


def test_what_a_drill_does_by_itself_is_no_command(history):
    tell(history, "journal", entry(1, "drive", SECOND, enabled=True, voltage=9.0, frequency=1e3))
    for time, lost in ((2, True), (3, True), (4, False)):
        tell(history, "status", status(time * SECOND, state="running", commands_lost=lost))
    tell(history, "journal", entry(2, "weight_on_bit", 2 * SECOND, force=1.0))
    tell(history, "journal", entry(3, "drive", 3 * SECOND, enabled=False))
    tell(history, "journal", entry(4, "weight_on_bit", 4 * SECOND, force=8.0))
    told = [(line["time"], line["kind"], line["text"]) for line in history.log()["log"]]
    assert told[1:] == [
        (1.0, "command", "drive 9 V at 1 kHz"),
        (2.0, "fault", "commands lost: drive and weight on bit fall to 0"),
        (4.0, "command", "weight on bit 8 N"),
    ]


def test_lost_messages_are_holes_of_their_topic(history):
    hear(history, "reacting_force", SECOND, force=5.0)
    later = batch("reacting_force", (3 * SECOND, {"force": 5.0}))
    history.settle([later], {"reacting_force": 40})
    signal = history.signal("reacting_force")
    assert history.holes(signal) == [(1.0, 3.0)]
    assert history.numbers(3.0)["reacting_force"]["lost"]
    layer = history.view(0.0, 3.0, 100, {"reacting_force": "band"})["layers"]["reacting_force"]
    assert layer["holes"] == [(1.0, 3.0)]
    impact(history, 3 * SECOND, 100.0)
    assert history.holes(history.signal("peak_force")) == []


def test_the_rate_of_lost_impacts_is_that_of_the_counter(history):
    hear(history, "reacting_force", 0, force=5.0)
    for time in (1, 2, 3):
        tell(history, "status", status(time * SECOND, state="running", impacts=400 * time))
    impact(history, 3 * SECOND // 2, 100.0)
    shown = history.numbers(3.0)
    assert shown["impact_rate"]["mean"] == pytest.approx(400.0, rel=0.06)
    assert (shown["peak_force"]["mean"], shown["peak_force"]["lost"]) == (None, True)
