"""A run carries out its plan, and its journal is a plan that gives the same messages again."""

import re
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import entries_in, examples

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import NEVER
from rpud_sim.messages.batch import rows_of
from rpud_sim.simulation.changes import (
    Change,
    ChangeError,
    Clear,
    Configure,
    Flush,
    Inject,
    SetOrigin,
    Stop,
)
from rpud_sim.simulation.commands import Drive, DriveChange, Feed, MountMotion, WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import CommandCounts, stamp_of
from rpud_sim.simulation.plan import Beginning, Journal, Plan
from rpud_sim.simulation.run import Run

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
ORIGIN = 1_700_000_000 * SECOND + 7
END = 100 * MILLISECOND
RATES = {"telemetry_rate": 200, "sample_rate": 20_000, "block_duration": 0.02}
MESSAGES = Path(__file__).parents[2] / "msg_defs" / "msg"
POWER, STATUS = MESSAGES / "Power.msg", MESSAGES / "Status.msg"


def fault(onset, clear, *words):
    return Change(onset, Inject(Fault(*words), clear - onset if clear else 0))


FAULTS = (
    fault(12_345_678, 40 * MILLISECOND, "lost_preload", "", 0.5),
    fault(20 * MILLISECOND, None, "noise", "wrench"),
)
ALL_FAULTS = (
    fault(5 * MILLISECOND, 70 * MILLISECOND, "delayed", "nodal_plane", 0.03),
    fault(7_654_321, 80 * MILLISECOND, "intermittent", "contact_force", 0.5),
    *FAULTS,
    fault(30 * MILLISECOND, None, "slow", "drill_tool", 0.025),
)


def begun(values=None, faults=(), journal=None, changes=(), **options):
    """Give a run that has begun, and the messages of its beginning."""
    beginning = Beginning(to_settings({**RATES, **(values or {})}), 0.3, 5, faults)
    run = Run(Plan(beginning, changes), journal, **options)
    run.begin(ORIGIN)
    return run, list(rows_of(run.changes()))


def advanced(run, time):
    return list(rows_of(run.advance_to(time)))


def same(one, other):
    """Whether messages are equal, NaN included; pytest's own comparison takes minutes."""
    return [*map(repr, one)] == [*map(repr, other)]


def topics(messages):
    return [topic for _, topic, _ in messages]


def kinds(messages):
    return [fields["kind"] for _, topic, fields in messages if topic == "journal"]


@pytest.mark.parametrize("planned", [False, True])
def test_an_entry_comes_before_its_consequences(planned):
    actions = WeightOnBit(30.0), Inject(Fault("free_mass_jammed"))
    changes = [Change(10 * MILLISECOND, action) for action in actions]
    run, _ = begun(journal=Journal(), changes=changes if planned else ())
    messages = advanced(run, 10 * MILLISECOND)
    if not planned:
        for action in actions:
            run.apply(action)
    messages = [*messages, *advanced(run, 20 * MILLISECOND)]
    first = topics(messages).index("journal")
    found = messages[first : first + 3]
    assert topics(found) == ["journal", "journal", "faults"]
    assert kinds(messages) == ["weight_on_bit", "inject"]
    assert all(time == 10 * MILLISECOND for time, _, _ in found)
    assert [stamp_of(fields) for _, _, fields in found] == [ORIGIN + 10 * MILLISECOND] * 3


@pytest.mark.parametrize(("ends", "kind"), [(False, "flush"), (True, "end")])
def test_stops_inside_a_block_and_a_flush_are_entries_before_their_messages(ends, kind):
    run, found = begun(journal=Journal())
    for stop, expected in ((10, []), (12, ["stop"]), (15, []), (27, ["stop"])):
        messages = advanced(run, stop * MILLISECOND)
        assert kinds(messages) == expected
        found += messages
    rest, again = (list(rows_of(run.flush(ends=ends))) for _ in range(2))
    assert kinds(rest) == [kind]
    assert topics(rest) == ["journal", "waveform", "trajectory"]
    assert topics(again) == ["journal"]
    entries = [fields for _, topic, fields in (*found, *rest, *again) if topic == "journal"]
    assert [fields["sequence"] for fields in entries] == list(range(len(entries)))


def test_faults_are_published_once_for_each_change():
    run, messages = begun(faults=FAULTS)
    messages += advanced(run, END)
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


def test_status_and_power_give_every_field_of_their_messages():
    run, _ = begun(journal=Journal())
    advanced(run, 10 * MILLISECOND)
    status = run.status("running", CommandCounts(commands_accepted=3))
    for batch, message in ((run.power(), POWER), (status, STATUS)):
        text = message.read_text()
        declared = re.findall(r"^[\w/]+ +([a-z]\w*) *(?:#.*)?$", text, re.MULTILINE)
        assert len(declared) > 10
        [(time, topic, fields)] = batch.rows()
        assert {*fields} == {*declared}
        assert (time, topic) == (10 * MILLISECOND, message.stem.lower())
        assert stamp_of(fields) == ORIGIN + 10 * MILLISECOND
    assert (fields["state"], fields["commands_accepted"]) == ("running", 3)
    assert fields["impacts"] == run.simulation.impact_count > 0
    assert fields["journal_entries"] == 2


def test_other_settings_reach_the_watchdog_and_the_drill():
    run, _ = begun({"command_timeout": 0.0})
    run.take_over()
    run.apply(Configure({"command_timeout": 0.01, "gravity": 1.62}))
    advanced(run, 20 * MILLISECOND)
    assert run.watch()
    assert run.commands_lost
    assert run.simulation.parameters.gravity == run.settings.values()["gravity"] == 1.62


# --- the plan ----------------------------------------------------------------------------------


def test_a_run_that_reports_has_a_status_at_each_second_and_after_each_change():
    changes = [
        Change(300 * MILLISECOND, WeightOnBit(12.0)),
        Change(300 * MILLISECOND, DriveChange(True, 80.0)),
        Change(400 * MILLISECOND, WeightOnBit(12.0)),  # acts already
    ]
    run, _ = begun(changes=changes, reports=True)
    messages = advanced(run, 2 * SECOND)
    found = [(t, f) for t, topic, f in messages if topic == "status"]
    assert [time for time, _ in found] == [t for t, topic, _ in messages if topic == "power"]
    assert [time for time, _ in found] == [300 * MILLISECOND, SECOND, 2 * SECOND]
    assert (found[0][1]["weight_on_bit"], found[0][1]["drive_voltage"]) == (12.0, 80.0)
    assert run.next_change == NEVER


def test_under_watch_the_loss_of_planned_commands_makes_the_drill_safe():
    values = {"command_timeout": 0.04, "command_loss_ramp": 0.02}
    run, _ = begun(values, journal=Journal(), reports=True)
    advanced(run, 10 * MILLISECOND)
    run.take_over()
    run.schedule(Change(30 * MILLISECOND, WeightOnBit(12.0)))
    messages = advanced(run, 60 * MILLISECOND)
    assert kinds(messages) == ["weight_on_bit"]
    messages = advanced(run, END)
    states = [fields for _, topic, fields in messages if topic == "status"]
    assert [states[n]["commands_lost"] for n in (0, -1)] == [True, True]
    assert (states[-1]["weight_on_bit"], states[-1]["drive_enabled"]) == (0.0, False)
    assert kinds(messages)[:2] == ["weight_on_bit", "drive"]


@pytest.mark.parametrize("rate", [100, 130])
def test_what_is_lost_goes_down_to_nothing_where_no_block_ends_with_the_ramp(rate):
    values = {"telemetry_rate": rate, "command_timeout": 0.04, "command_loss_ramp": 0.02}
    run, _ = begun(values)
    run.take_over()
    advanced(run, 80 * MILLISECOND)
    advanced(run, 100 * MILLISECOND)
    applied = run.simulation.applied
    assert (applied.weight_on_bit.force, applied.drive.enabled) == (0.0, False)


@pytest.mark.parametrize(
    ("action", "reason"),
    [
        (Clear(3), "there is no fault 3 to clear"),
        (Clear(0, "noise", "wrench"), "there is no noise on wrench to clear"),
        (Inject(Fault("feed_stall")), "feed_stall is not possible"),
        (Feed("rate", 1e-3), "feed"),
        (MountMotion(1e-3), "the motion of the mount"),
        (Configure({"weight_on_bit": -1.0}), "weight_on_bit = -1"),
        (Configure({"no such": 1.0}), "no such"),
    ],
)
def test_a_change_that_cannot_be_carried_out_ends_the_run_or_is_refused(action, reason):
    change = Change(5 * MILLISECOND, action, "here: ")
    run, _ = begun(changes=[change])
    with pytest.raises(ChangeError, match=f"^here: .*{re.escape(reason)}"):
        advanced(run, END)
    refused = []
    run, _ = begun(changes=[change], rejected=lambda *words: refused.append(words))
    advanced(run, END)
    [(found, error)] = refused
    assert (found, run.time) == (change, END)
    assert isinstance(error, ParameterError)
    assert run.simulation.faults.records == ()


ACTIONS = st.one_of(
    st.builds(WeightOnBit, st.floats(0.0, 20.0)),
    st.builds(Drive, st.booleans(), st.floats(0.0, 100.0), st.floats(15e3, 17e3)),
    st.builds(DriveChange, st.booleans(), st.none() | st.floats(0.0, 100.0)),
    st.builds(
        lambda value: Configure(
            {"actuator_restitution": value, "regime": "free" if value < 0.7 else "drilling"}
        ),
        st.floats(0.5, 0.9),
    ),
    st.builds(
        Inject, st.builds(Fault, st.just("bias"), st.just("wrench")), st.integers(0, 60_000_000)
    ),
    st.sampled_from(
        [Clear(), Clear(0, "bias", "wrench"), SetOrigin(5), SetOrigin(ORIGIN + 1), Stop()]
    ),
    st.builds(Flush),
)
STEPS = st.lists(st.tuples(st.integers(1, 30 * MILLISECOND), ACTIONS), max_size=8)


@settings(max_examples=examples(20))
@given(
    regime=st.sampled_from(["free", "drilling"]),
    faults=st.sampled_from([(), ALL_FAULTS]),
    steps=STEPS,
)
def test_what_was_done_is_a_plan_that_gives_every_message_again(regime, faults, steps):
    run, messages = begun({"regime": regime}, faults, Journal())
    for length, action in steps:
        messages += advanced(run, run.time + length)
        with suppress(ParameterError):  # there may be such a fault already, or none
            run.apply(action)
        if isinstance(action, Flush):
            messages += rows_of(run.flush())
    messages += advanced(run, run.time + 31 * MILLISECOND)
    messages += rows_of(run.flush(ends=True))
    again = Run(Plan.of(entries_in(messages)), Journal(1))
    found = list(rows_of(again.advance_to(run.time)))
    assert list(map(repr, found)) == list(map(repr, messages[1:]))


@settings(max_examples=examples(10))
@given(steps=STEPS)
def test_planned_changes_are_those_that_are_carried_out_at_their_times(steps):
    times = [sum(length for length, _ in steps[: n + 1]) for n in range(len(steps))]
    changes = [Change(t, action) for t, (_, action) in zip(times, steps, strict=True)]
    planned, found = begun(changes=changes, rejected=lambda *words: None)
    found += advanced(planned, 300 * MILLISECOND)
    run, messages = begun()
    for change in changes:
        messages += advanced(run, change.time)
        with suppress(ParameterError):
            run.apply(change.action)
        messages += rows_of(run.flush() if isinstance(change.action, Flush) else run.changes())
    messages += advanced(run, 300 * MILLISECOND)
    assert list(map(repr, found)) == list(map(repr, messages))


@pytest.mark.parametrize("arm", [False, True])
@pytest.mark.parametrize("actuator", ["gain", "resonance"])
def test_commands_of_one_time_give_the_same_bits_and_journal_in_every_order(arm, actuator):
    values = {"actuator_model": actuator, **({"feed_model": "arm"} if arm else {})}
    commands = [Drive(True, 70.0, 16_100.0), Feed("rate", 0.002) if arm else WeightOnBit(17.0)]
    found = []
    for order in (commands, commands[::-1]):
        run, messages = begun(values, journal=Journal())
        messages += advanced(run, 23_456_789)
        for command in order:
            run.apply(command)
        messages += [*rows_of(run.changes()), *advanced(run, END)]
        found.append(messages)
    assert same(*found)
    assert kinds(found[0])[-2:] == (["drive", "feed"] if arm else ["weight_on_bit", "drive"])


@given(
    timeout=st.floats(0.001, 0.08),
    ramp=st.sampled_from([0.0, 0.013, 0.05]),
    count=st.integers(0, 3),
)
@settings(max_examples=examples(30))
def test_watched_in_spans_a_loss_of_commands_has_the_same_bits(timeout, ramp, count):
    """The watchdog acts at the ends of the same blocks as where each of them is looked at."""
    found = []
    for spans in (True, False):
        run, _ = begun({"command_timeout": timeout, "command_loss_ramp": ramp}, journal=Journal())
        run.take_over()
        for number in range(count):
            run.schedule(Change(20 * MILLISECOND * (number + 1), WeightOnBit(10.0 + number)))
        messages = []
        while run.time < 2 * END:
            messages += advanced(run, 2 * END if spans else min(run.next_boundary, run.next_change))
        found.append(messages)
    assert same(*found)
