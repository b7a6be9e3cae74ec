"""Plans: beginnings, changes in order of time, and both out of a journal."""

import pytest

from rpud_sim.drilling.rock import Strata, preset_layer
from rpud_sim.foundation.time import NEVER
from rpud_sim.simulation.changes import (
    Change,
    ChangeError,
    Configure,
    PlannedChanges,
    Schedule,
    SetOrigin,
    Stop,
    journal_form,
    parameter_changes,
)
from rpud_sim.simulation.commands import Drive, DriveChange, WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.plan import (
    STRATA_REACH,
    Beginning,
    Journal,
    JournalEntry,
    Plan,
    StrataTexts,
    initial_phases,
)


def test_phases_are_those_of_the_seed_and_one_run_without_it_begins_at_zero():
    assert initial_phases(1, None) == (0.0,) != initial_phases(1, 7)
    assert initial_phases(5, 7)[:3] == initial_phases(3, 7)
    assert initial_phases(5, 7) != initial_phases(5, 8)
    assert initial_phases(5, None) == initial_phases(5, 0)
    assert all(0.0 <= phase < 1.0 for phase in initial_phases(1000, 1))


def test_the_seed_of_the_settings_holds_unless_another_is_given():
    settings = to_settings({"seed": 4})
    assert Beginning.drawn(settings) == Beginning.drawn(settings, 4)
    other = to_settings({"seed": 9})
    assert Beginning.drawn(settings, 9) == Beginning(other, initial_phases(1, 9)[0], 9)
    assert Beginning.drawn(settings, 0).initial_phase == initial_phases(1, 0)[0] > 0.0
    assert Beginning.drawn(to_settings({})).initial_phase == 0.0


BEGIN = Beginning(to_settings({"regime": "free"})).to_journal()


@pytest.mark.parametrize(
    ("kind", "time", "content", "reason"),
    [
        ("explode", 5, {}, "there is no such kind"),
        ("stop", 4, {}, "before the previous entry's time"),
        ("weight_on_bit", 5, {"force": -1.0}, "weight_on_bit = -1 N is outside its range"),
        ("weight_on_bit", 5, {}, "it has no 'force'"),
        ("begin", 5, BEGIN, "there is no such kind"),
        ("inject", 5, {"fault": {"kind": "lost_preload"}, "duration": 1.5}, "1.5 is not a time"),
    ],
)
def test_an_entry_that_cannot_be_done_is_named(kind, time, content, reason):
    entries = [JournalEntry(0, 0, "begin", BEGIN), JournalEntry(1, 5, "stop", {})]
    assert Plan.of(entries).changes == (Change(5, Stop()),)
    with pytest.raises(ChangeError, match=rf"^journal entry 2 \({kind}\) cannot be done: .*") as e:
        Plan.of([*entries, JournalEntry(2, time, kind, content)])
    assert reason in str(e.value)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"parameters": {}}, "it has no "),
        ({**BEGIN, "parameters": {"telemetry_rate": 0}}, "telemetry_rate = 0"),
        ({**BEGIN, "faults": [{"kind": "noise"}]}, "it has no "),
        ({**BEGIN, "seed": 1e308}, "seed = 1e"),
        (
            {**BEGIN, "faults": [{**vars(Fault("off", "wrench")), "onset": 0.5, "clear": None}]},
            "0.5 is not a time",
        ),
    ],
)
def test_a_beginning_that_cannot_be_is_named(content, reason):
    with pytest.raises(ChangeError, match=rf"^journal entry 0 \(begin\) .*{reason}"):
        Plan.of([JournalEntry(0, 0, "begin", content)])


def test_a_journal_without_a_beginning_is_no_plan():
    for entries in ([], [JournalEntry(0, 0, "stop", {})]):
        with pytest.raises(ChangeError, match="nothing has begun"):
            Plan.of(entries)


def test_a_schedule_is_in_order_of_time_and_the_ends_of_faults_come_first():
    one, other, end, late = (Change(t, WeightOnBit(n)) for n, t in enumerate((5, 5, 5, 9)))
    schedule = Schedule([late, one, other])
    schedule.add(end, first=True)
    assert schedule.next == 5
    assert [*schedule.due(8)] == [end, one, other]
    assert ([*schedule.due(9)], schedule.next) == ([late], NEVER)


def test_of_two_sets_of_changes_the_later_comes_last():
    one = parameter_changes({"gravity": 1.62, "weight_on_bit": 12.0})
    other = PlannedChanges((Change(0, Configure({"gravity": 3.7})),), replaces_commands=True)
    both = one + other
    assert both.changes == (*one.changes, *other.changes)
    assert both.parameters == {"gravity": 3.7}
    assert both.replaces_commands
    assert not both.empty
    assert PlannedChanges().empty


def layered(count):
    """Return the content of a beginning with so many layers."""
    layers = tuple(preset_layer("basalt", 1e-4 * number) for number in range(count))
    return Beginning(to_settings({"strata": Strata(layers).to_text()})).to_journal()


def test_a_reset_takes_as_many_bytes_with_many_strata_as_with_few():
    sizes = set()
    for count in (10, 1000):
        journal, strata = Journal(), StrataTexts()
        content = layered(count)
        for number in (0, 3, 6):
            journal.record(0, "begin", content)
            [begin] = journal.drain()
            assert strata.complete(number, begin.content) == content
            for _ in range(2):
                journal.record(0, *journal_form(Stop()))
            journal.drain()
        sizes.add(len(begin.text))
    assert len(sizes) == 1
    assert begin.content["parameters"]["strata"] == {"same_as_entry": 0}


def test_strata_are_stated_again_if_they_are_others_or_far_back():
    journal = Journal()
    first, other = layered(10), layered(11)
    for content in (first, other, other, first):
        journal.record(0, "begin", content)
    stated = [each.content["parameters"]["strata"] for each in journal.drain()]
    texts = [each["parameters"]["strata"] for each in (first, other)]
    assert stated == [*texts, {"same_as_entry": 1}, texts[0]]
    for _ in range(STRATA_REACH - 1):
        journal.record(0, *journal_form(Stop()))
    journal.record(0, "begin", first)
    assert journal.drain()[-1].content == first


def test_short_strata_are_in_each_beginning():
    journal = Journal()
    content = Beginning(to_settings({"strata": "sandstone"})).to_journal()
    for _ in range(2):
        journal.record(0, "begin", content)
    assert [each.content for each in journal.drain()] == [content, content]


@pytest.mark.parametrize("known", [{}, {0: 10}, {1: 10}])
def test_strata_whose_entry_is_missing_are_an_error(known):
    strata = StrataTexts()
    for number, count in known.items():
        strata.complete(number, layered(count))
    content = {"parameters": {"strata": {"same_as_entry": 2}}}
    with pytest.raises(ChangeError, match="journal entry 5 has the strata of entry 2: missing"):
        strata.complete(5, content)


def test_origins_of_which_nothing_was_published_leave_one_entry():
    journal = Journal()
    for time, origin in ((0, 1), (0, 2), (5, 3)):
        journal.record(time, *journal_form(SetOrigin(origin)))
    entries = journal.drain()
    assert [(e.sequence, e.content["origin"]) for e in entries] == [(0, 2), (1, 3)]
    assert journal.drain() == []


def test_a_drive_may_leave_values_as_they_are():
    before = Drive(True, 80.0, 16_050.0)
    assert DriveChange(False).on(before) == Drive(False, 80.0, 16_050.0)
    assert DriveChange(True, frequency=16e3).on(before) == Drive(True, 80.0, 16e3)
