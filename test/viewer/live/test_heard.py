"""What has been heard of a drill, from messages as they come."""

import json
import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rpud_msgs.msg import Fault, Faults, JournalEntry, Status

from rpud_sim.watch.heard import BIN, Heard

SECOND = 1_000_000_000
ORIGIN = 1_700_000_000 * SECOND + 123


def stamp(nanoseconds):
    return Time(sec=nanoseconds // SECOND, nanosec=nanoseconds % SECOND)


def entry(number, kind, time, **content):
    message = JournalEntry(
        sequence=number, kind=kind, content=json.dumps({"time": time, **content})
    )
    message.header.stamp = stamp(ORIGIN + time)
    return message


def status(time, **fields):
    message = Status(**fields)
    message.header.stamp = stamp(ORIGIN + time)
    message.weight_on_bit_applied = message.drive_applied = stamp(ORIGIN)
    return message


@pytest.fixture
def heard():
    heard = Heard()
    heard.latched("journal", entry(0, "begin", 0))
    return heard


def impact(heard, time, force, energy=1.0):
    heard.contact_force(ORIGIN + time, (0, force, 1e-5, 2.0, 0.01, energy, 0.5 * energy, False))


def test_times_count_from_the_origin_that_the_journal_tells(heard):
    heard.latched("status", status(2 * SECOND, state="running", weight_on_bit=12.0))
    assert heard.time == 2.0
    assert heard.status["weight_on_bit"] == 12.0
    assert heard.status["weight_on_bit_applied"] == 0.0


def test_status_and_faults_before_the_journal_are_shown_as_soon_as_it_comes():
    heard = Heard()
    heard.latched("status", status(SECOND, state="paused"))
    fault = Fault(number=1, kind="bias", active=True, onset=stamp(ORIGIN + SECOND // 2))
    faults = Faults(faults=[fault])
    faults.header.stamp = stamp(ORIGIN + SECOND)
    heard.latched("faults", faults)
    assert not heard.status
    heard.latched("journal", entry(0, "begin", 0))
    assert heard.status["state"] == "paused"
    assert [(each.kind, each.onset, each.end) for each in heard.faults] == [("bias", 0.5, None)]


def test_a_bin_holds_extremes_counts_and_sums(heard):
    for time, force, energy in ((0, 5.0, 1.0), (BIN - 1, 9.0, 2.0), (BIN, 7.0, 4.0)):
        impact(heard, time, force, energy)
    series = heard.series
    assert series.column("peak_force_min").tolist() == [5.0, 7.0]
    assert series.column("peak_force_max").tolist() == [9.0, 7.0]
    assert series.column("impacts").tolist() == [2.0, 1.0]
    assert series.column("energy").tolist() == [3.0, 4.0]
    assert (series.first, series.period) == (0, BIN / SECOND)
    assert heard.impact.time == BIN / SECOND


def test_a_faulty_signal_without_a_number_leaves_the_bin_empty(heard):
    heard.samples("reacting_force", ORIGIN, (math.nan,))
    assert np.isnan(heard.series.column("reacting_force_min")).all()


def test_a_block_of_the_waveform_fills_the_bins_that_it_reaches(heard):
    period, length = 1e-3, 100
    mass = np.arange(length, dtype=float)
    arrays = (np.zeros(length), np.zeros(length), mass, *(np.zeros(length) for _ in range(3)))
    heard.waveform(ORIGIN + BIN // 2, (0, period, arrays))
    series = heard.series
    assert series.column("free_mass_min").tolist() == [0.0, 25.0, 75.0]
    assert series.column("free_mass_max").tolist() == [24.0, 74.0, 99.0]
    assert heard.section.time == 0.025


def test_a_malformed_block_is_ignored(heard):
    arrays = tuple(np.zeros(length) for length in (3, 3, 2, 3, 3, 3))
    heard.waveform(ORIGIN, (0, 1e-3, arrays))
    heard.waveform(ORIGIN, (0, math.nan, tuple(np.zeros(3) for _ in range(6))))
    assert heard.section is None


def test_a_reset_begins_a_new_run_with_empty_series(heard):
    impact(heard, 0, 5.0)
    heard.latched("journal", entry(1, "weight_on_bit", SECOND, force=3.0))
    assert [mark.text for mark in heard.marks] == ["weight_on_bit: force 3"]
    heard.latched("journal", entry(2, "begin", 0))
    assert (heard.run, len(heard.series.rows), heard.impact, list(heard.marks)) == (2, 0, None, [])


def test_a_reset_of_a_clock_that_begins_at_zero_forgets_the_status_of_the_run_before(heard):
    heard.latched("status", status(5 * SECOND, state="running"))
    heard.latched("journal", entry(1, "begin", 0))
    assert (heard.time, heard.status) == (None, {})
    heard.latched("status", status(0, state="paused"))
    assert (heard.time, heard.status["state"]) == (0.0, "paused")


def test_the_status_of_a_new_run_may_come_before_its_journal(heard):
    heard.latched("status", status(0, state="paused"))
    heard.latched("journal", entry(1, "begin", 0))
    assert heard.status["state"] == "paused"


def test_a_drill_that_is_gone_stays_on_the_picture_until_another_begins(heard):
    impact(heard, SECOND, 5.0)
    heard.restart()
    impact(heard, 9 * SECOND, 6.0)  # of the next one, before its journal
    assert heard.impact.peak_force == 5.0
    assert heard.impact.time == 1.0
    heard.latched("journal", entry(0, "begin", 0))
    assert (heard.run, heard.impact) == (2, None)


def test_a_jump_in_the_journal_is_counted_as_lost(heard):
    heard.latched("journal", entry(4, "flush", SECOND))
    assert heard.journal_lost == {"journal": 3}


@pytest.mark.parametrize("content", ["", "[", "[]", "{}", '{"time": "x"}', '{"time": 1e99}'])
def test_a_journal_of_a_stranger_is_ignored(heard, content):
    message = entry(1, "begin", 0)
    message.content = content
    heard.latched("journal", message)
    assert heard.run == 1
