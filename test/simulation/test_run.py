"""A run gives the same messages in pieces as in one go, each change once and in its order."""

import dataclasses
import json
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import Bookkeeping, stamp_of
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.scenario import Scenario, ScheduledFault
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


@settings(max_examples=10)
@given(
    regime=st.sampled_from(["free", "drilling"]),
    stops=st.lists(st.integers(1, END - 1), max_size=8),
)
def test_in_pieces_it_gives_the_same_messages_as_in_one_go(regime, stops):
    scenario = Scenario(0, tuple(sorted([*SCENARIO.faults, *SIGNALS], key=lambda one: one.onset)))
    whole, first = begun({"regime": regime}, scenario)
    expected = [*first, *whole.advance_to(END), *whole.flush()]
    pieces, found = begun({"regime": regime}, scenario)
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


def test_at_the_boundaries_even_the_order_is_the_same_and_every_block_is_counted_once():
    blocks = []
    whole, _ = begun(scenario=SCENARIO)
    pieces, _ = begun(scenario=SCENARIO, on_block=blocks.append)
    expected = [repr(message) for message in whole.advance_to(END)]
    found = []
    while pieces.time < END:
        found += [repr(message) for message in pieces.advance_to(pieces.next_boundary)]
    assert found == expected
    ends = [0, *(block.end for block in blocks)]
    assert [block.start for block in blocks] == ends[:-1]
    assert ends[-1] == END


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
