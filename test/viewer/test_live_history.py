"""What has been history of a drill, from messages as they come, and what is drawn of it."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rpud_msgs.msg import CommandResult, CommandResults, Fault, Faults, JournalEntry, Status

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


@pytest.fixture
def history():
    history = LiveHistory()
    history.latched("journal", entry(0, "begin", 0, parameters=PARAMETERS))
    return history


def hear(history, topic, time, *values):
    history.sinks()[topic](ORIGIN + time, values, 0)
    history.settle()


def impact(history, time, force):
    hear(history, "contact_force", time, 0, force, 1e-5, 2.0, 0.01, 1.0, 0.5, False)


def texts(history):
    return [line["text"] for line in history.commands.frame(history.faults)["log"]]


def test_status_and_faults_before_the_journal_are_shown_as_soon_as_it_comes():
    history = LiveHistory()
    history.latched("status", status(SECOND, state="paused"))
    fault = Fault(number=1, kind="bias", active=True, onset=stamp(ORIGIN + SECOND // 2))
    faults = Faults(faults=[fault])
    faults.header.stamp = stamp(ORIGIN + SECOND)
    history.latched("faults", faults)
    assert not history.reports
    history.latched("journal", entry(0, "begin", 0, parameters=PARAMETERS))
    assert (history.time, history.reports["status"]["state"]) == (1.0, "paused")
    assert history.reports["status"]["weight_on_bit_applied"] == 0.0
    [shown] = history.faults
    assert (shown["kind"], shown["onset"], shown["end"]) == ("bias", 0.5, None)


@pytest.mark.parametrize("reset", [0, 3 * SECOND])  # the stamp: the clock begins again, or goes on
def test_a_fault_is_shown_to_who_joins_after_a_reset(reset):
    history = LiveHistory()
    faults = Faults(faults=[Fault(number=1, kind="bias", active=True, onset=stamp(ORIGIN + reset))])
    faults.header.stamp = stamp(ORIGIN + 4 * SECOND)
    history.latched("faults", faults)
    begins = [entry(number, "begin", 0, parameters=PARAMETERS) for number in range(2)]
    begins[1].header.stamp = stamp(ORIGIN + reset)
    for begin in begins:
        history.latched("journal", begin)
    [shown] = history.faults
    assert (shown["kind"], shown["onset"]) == ("bias", 0.0)


def test_all_quantities_of_the_whole_run_are_kept(history):
    sinks = history.sinks()
    for time, force in ((0, 5.0), (SECOND // 25, 9.0), (SECOND // 20, 7.0), (3 * SECOND, 1.0)):
        sinks["reacting_force"](ORIGIN + time, (force, 0), 0)
        sinks["contact_force"](ORIGIN + time, (0, force, 1e-5, 2.0, 0.01, 1.0, 0.5, False), 0)
    history.settle()
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
    history.latched("status", status(3 * SECOND))
    assert frame()["numbers"]["impact_rate"]["mean"] == 0.0
    impact(history, 5 * SECOND // 2, 300.0)
    shown = frame()
    assert shown["numbers"]["impact_rate"]["mean"] == 1.0
    assert np.nanmax(shown["timeline"]["high"]) == 300.0
    impact(history, 2 * SECOND, 900.0)
    assert np.nanmax(frame()["timeline"]["high"]) == 900.0
    assert "numbers" not in frame()


def test_a_command_that_is_heard_before_its_time_is_a_step(history, frame):
    history.latched("status", status(SECOND))
    frame()
    history.latched("journal", entry(1, "weight_on_bit", 2 * SECOND, force=20.0))
    assert frame()["steps"]["weight_on_bit"]["v"].tolist() == [8.0, 20.0]


def test_an_impact_that_is_heard_after_its_block_is_in_the_section(history, frame):
    block = 1e-4, tuple(np.full(200, number) for number in range(6))
    hear(history, "reacting_force", 0, 1.0, 0)
    hear(history, "waveform", SECOND, 0, *block)
    assert frame(section=True)["section"]["impacts"] == []
    assert "section" not in frame(section=True)
    impact(history, SECOND + SECOND // 100, 300.0)
    [[time, *_]] = frame(section=True)["section"]["impacts"]
    assert time == pytest.approx(0.01)


def test_a_block_of_the_waveform_is_shown_when_its_impacts_had_time_to_arrive(history):
    arrays = tuple(np.full(100, number) for number in range(6))
    hear(history, "reacting_force", SECOND // 2, 7.0, 0)
    hear(history, "waveform", SECOND // 2, 0, 1e-3, arrays)
    history.settle()
    assert history.block is None  # other topics may not be history yet
    hear(history, "waveform", SECOND, 0, 1e-3, arrays)
    assert history.block is None
    history.settle()
    assert history.block == (1.0, 1e-3, arrays)


def test_a_reset_begins_a_new_run_with_nothing(history):
    impact(history, 0, 5.0)
    history.latched("journal", entry(1, "weight_on_bit", SECOND, force=3.0))
    assert texts(history) == ["a run begins", "weight on bit 3 N"]
    history.latched("journal", entry(2, "begin", 0, parameters=PARAMETERS))
    assert (history.run, history.impacts.total, history.values) == (2, 0, {})
    assert texts(history) == ["a run begins"]


def test_what_was_published_before_a_reset_is_of_the_run_before(history):
    """The stamps go back, as after a long step, and no order holds among topics."""
    hear_force = history.sinks()["reacting_force"]
    history.latched("status", status(5 * SECOND, state="running"), 90)
    hear_force(ORIGIN + 5 * SECOND, (5.0, 0), 91)
    hear_force(ORIGIN + SECOND // 10, (7.0, 0), 101)
    history.latched("journal", entry(1, "begin", 0, parameters=PARAMETERS), 100)
    assert (history.time, history.reports) == (None, {})
    history.latched("status", status(4 * SECOND, state="running"), 98)
    hear_force(ORIGIN + 4 * SECOND, (6.0, 0), 99)
    history.settle()
    assert (history.time, history.values["reacting_force"]["force"]) == (0.1, 7.0)
    history.latched("status", status(SECOND, state="paused"), 102)
    assert (history.time, history.reports["status"]["state"]) == (1.0, "paused")


def test_stamps_that_begin_anew_move_nothing_of_the_same_run(history):
    """A pause of 60 s is over; the status with a new stamp comes before the journal says so."""
    hear(history, "reacting_force", 1 * SECOND, 5.0, 0)
    history.sinks()["reacting_force"](ORIGIN + 1_100_000_000, (6.0, 0), 0)
    history.latched("status", status(61_200_000_000))
    pause = 60 * SECOND
    history.latched("journal", entry(1, "origin", 1_200_000_000, ORIGIN + pause))
    hear(history, "reacting_force", 1_300_000_000 + pause, 7.0, 0)
    assert history.time == 1.3
    bins = history.bins[0].view("reacting_force force", 0.0, 100.0, 10_000)
    used = bins["mean"] > 0.0
    assert [*zip(bins["t"][used].round(3), bins["mean"][used], strict=True)] == [
        (1.025, 5.0),
        (1.125, 6.0),
        (1.325, 7.0),
    ]


def test_a_drill_that_is_gone_stays_until_another_begins(history):
    impact(history, SECOND, 5.0)
    history.restart()
    impact(history, 9 * SECOND, 6.0)  # of the next one, before its journal
    assert history.impacts.between(0.0, 20.0)[0].tolist() == [1.0]
    history.latched("journal", entry(0, "begin", 0, parameters=PARAMETERS))
    assert (history.run, history.impacts.total) == (2, 0)


def test_a_late_screen_holds_entries_until_it_has_those_before():
    history = LiveHistory()
    history.latched("journal", entry(5, "weight_on_bit", 2 * SECOND, force=3.0))
    assert (history.run, len(history.held)) == (0, 1)
    history.complete([entry(0, "begin", 0, parameters=PARAMETERS)])
    history.release()
    assert texts(history) == ["a run begins", "weight on bit 3 N"]
    history.latched("journal", entry(6, "weight_on_bit", 3 * SECOND, force=4.0))
    assert texts(history)[-1] == "weight on bit 4 N"


def test_a_jump_in_the_journal_is_counted_as_lost(history):
    history.latched("journal", entry(4, "flush", SECOND))
    assert history.journal_lost == 3


@pytest.mark.parametrize(
    "content", ["", "[" * 99999, "[]", '{"time": "now"}', f'{{"time": {10**30}}}']
)
def test_what_another_program_writes_into_the_journal_changes_nothing(history, content):
    history.latched("journal", JournalEntry(sequence=1, kind="begin", content=content))
    assert history.run == 1


def test_refusals_stand_at_their_time_and_not_in_the_run_after_them():
    def refused(time, reason):
        result = CommandResult(kind="drive", accepted=False, reason=reason)
        message = CommandResults(results=[result], repeated=0)
        message.header.stamp = stamp(ORIGIN + time)
        return message

    history = LiveHistory()
    history.latched("command_results", refused(7 * SECOND, "old"), 90)
    history.latched("journal", entry(0, "begin", 0, parameters=PARAMETERS), 100)
    history.latched("command_results", refused(2 * SECOND, "new"), 110)
    log = history.log()["log"]
    assert [(line["time"], line["text"]) for line in log] == [
        (0.0, "a run begins"),
        (2.0, "rejected: new"),
    ]


def test_what_a_drill_does_by_itself_is_no_command(history):
    history.latched("journal", entry(1, "drive", SECOND, enabled=True, voltage=9.0, frequency=1e3))
    for time, lost in ((2, True), (3, True), (4, False)):
        history.latched("status", status(time * SECOND, state="running", commands_lost=lost))
    history.latched("journal", entry(2, "weight_on_bit", 2 * SECOND, force=1.0))
    history.latched("journal", entry(3, "drive", 3 * SECOND, enabled=False))
    history.latched("journal", entry(4, "weight_on_bit", 4 * SECOND, force=8.0))
    told = [(line["time"], line["kind"], line["text"]) for line in history.log()["log"]]
    assert told[1:] == [
        (1.0, "command", "drive 9 V at 1 kHz"),
        (2.0, "fault", "commands lost: drive and weight on bit fall to 0"),
        (4.0, "command", "weight on bit 8 N"),
    ]


def test_lost_messages_are_holes_of_their_topic(history):
    hear(history, "reacting_force", SECOND, 5.0, 0)
    history.sinks()["reacting_force"](ORIGIN + 3 * SECOND, (5.0, 0), 0)
    history.settle({"reacting_force": 40})
    signal = history.signal("reacting_force")
    assert history.holes(signal) == [(1.0, 3.0)]
    assert history.numbers(3.0)["reacting_force"]["lost"]
    layer = history.view(0.0, 3.0, 100, {"reacting_force": "band"})["layers"]["reacting_force"]
    assert layer["holes"] == [(1.0, 3.0)]
    impact(history, 3 * SECOND, 100.0)
    assert history.holes(history.signal("peak_force")) == []


def test_the_rate_of_lost_impacts_is_that_of_the_counter(history):
    hear(history, "reacting_force", 0, 5.0, 0)
    for time in (1, 2, 3):
        history.latched("status", status(time * SECOND, state="running", impacts=400 * time))
    impact(history, 3 * SECOND // 2, 100.0)
    shown = history.numbers(3.0)
    assert shown["impact_rate"]["mean"] == pytest.approx(400.0, rel=0.06)
    assert (shown["peak_force"]["mean"], shown["peak_force"]["lost"]) == (None, True)
