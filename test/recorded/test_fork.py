"""A recorded run goes on from any instant bit for bit, or the reason is named why it cannot."""

import json
import tempfile
from pathlib import Path

import pytest
from altered_bags import altered, numbered
from forked_runs import (
    FAULTS,
    JOURNAL,
    MILLISECOND,
    SECOND,
    decoded,
    entries_of,
    held,
    manifest_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_bags import write_offline_bag
from support import examples, extended

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.fork import write_fork
from rpud_sim.recorded.verify import verify
from rpud_sim.simulation import preset
from rpud_sim.simulation.changes import parameter_changes
from rpud_sim.simulation.scenario_file import parse_injections, read_commands
from rpud_sim.simulation.topics import PROVED


@settings(max_examples=examples(8), deadline=None)
@given(place=st.floats(0.0, 1.0, exclude_max=True), run=st.integers(1, 2))
def test_without_a_change_it_is_the_rest_of_the_run(used, place, run):
    path, published = used.path, used.published
    times = [time for number, time, _, _ in published if number == run]
    time = int(place * max(times))
    with tempfile.TemporaryDirectory() as folder:
        write_fork(path, Path(folder, "fork"), time / SECOND, run=run)
        origin = min(t for t, _, _ in held(Path(folder, "fork")))
        found = [each for each in held(Path(folder, "fork")) if each[0] > origin]
    for topic in (f"/rpud/{name}" for name in (*PROVED, "journal")):
        rest = [data for n, t, name, data in published if (n, name) == (run, topic) and t > time]
        forked = [data for _, name, data in found if name == topic]
        if run == 1 and topic == JOURNAL:  # it ended by a reset, and its fork by itself
            rest, forked = rest[:-1], forked[:-1]
        assert forked == rest, topic


@settings(max_examples=examples(8), deadline=None)
@given(place=st.floats(0.0, 1.0, exclude_max=True))
def test_of_a_bag_without_ros_every_message_and_time_is_the_same(plain, place):
    time = int(place * 300 * MILLISECOND)
    with tempfile.TemporaryDirectory() as folder:
        forked = write_fork(plain, Path(folder, "fork"), time / SECOND)
        found = [each for each in held(Path(folder, "fork")) if each[0] > time]
        proved = verify(Path(folder, "fork")).proved
    assert found == [each for each in held(plain) if each[0] > time]
    assert proved
    assert not forked.changed


@pytest.mark.parametrize("at", [extended(0.0), 0.0567, extended(0.1)])
@pytest.mark.parametrize("run", [1, 2])
def test_it_is_proved_itself_and_can_be_forked(used, tmp_path, at, run):
    path = used.path
    at = min(at, 0.06) if run == 2 else at
    changes = parse_injections(["restitution_loss,magnitude=0.8,onset=0.0031"])
    write_fork(path, tmp_path / "fork", at, 0.1, changes, run=run)
    verification = verify(tmp_path / "fork")
    assert verification.proved, verification
    assert verification.warnings == ()
    time = round(at * SECOND) + 5 * MILLISECOND
    write_fork(tmp_path / "fork", tmp_path / "again", time / SECOND)
    assert verify(tmp_path / "again").proved
    begin = min(t for t, _, _ in held(tmp_path / "again"))
    rest = [each for each in held(tmp_path / "again") if each[0] > begin]
    assert rest == [each for each in held(tmp_path / "fork") if each[0] > begin]


def test_it_names_where_it_came_from(plain, tmp_path):
    changes = parameter_changes({"gravity": 1.62}) + parse_injections(
        ["restitution_loss,duration=0.1"]
    )
    changes += parameter_changes({"weight_on_bit": 30})
    write_fork(plain, tmp_path / "fork", 0.1, 0.05, changes)
    origin = manifest_of(tmp_path / "fork").forked_from
    assert (origin["bag"], origin["run"], origin["at"]) == (str(plain), 1, 0.1)
    assert len(origin["journal"]) == 64
    changed, injected, commanded = origin["changes"]["planned"]
    assert origin["changes"]["parameters"] == changed["parameters"] == {"gravity": 1.62}
    assert [each["delay"] for each in (changed, injected, commanded)] == [0.0] * 3
    assert (injected["fault"]["kind"], commanded["force"]) == ("restitution_loss", 30.0)
    assert manifest_of(plain).forked_from == {}


def test_it_may_go_on_beyond_the_end_of_the_recorded_run(plain, tmp_path):
    forked = write_fork(plain, tmp_path / "fork", 0.3, 0.2)
    assert forked.duration == pytest.approx(0.2)
    assert verify(tmp_path / "fork").proved
    whole = tmp_path / "whole"
    write_offline_bag(whole, preset("drilling"), 0.5, 0.2, FAULTS, 11)
    planes = {"/rpud/nodal_plane", "/rpud/contact_force"}
    rest = [each for each in held(whole, planes) if each[0] > 300 * MILLISECOND]
    # A contact that had not ended at the instant is published after it.
    assert [each for each in held(tmp_path / "fork", planes) if each[0] > 300 * MILLISECOND] == rest


def test_a_bag_that_ended_before_the_drill_is_forked_to_its_own_end(plain, tmp_path):
    """As after a crash of the recorder: no end in the journal, and the last blocks are missing."""

    def change(message):
        return [message.data] if message.log_time <= 234 * MILLISECOND else []

    torn = altered(plain, tmp_path / "torn", change)
    forked = write_fork(torn, tmp_path / "fork", 0.1)
    assert forked.duration == pytest.approx(0.13)
    assert verify(tmp_path / "fork").proved


def without_entry(number):
    """Return a change that loses one entry of the journal; none of number None."""
    return numbered("journal", number, lambda message: [])


@pytest.mark.parametrize(
    ("lost", "words", "options", "reason"),
    [
        (6, (0.15,), {}, "complete up to .* alone: .* 6 to 6 .* are missing"),
        (6, (0.01,), {}, "give a --duration that ends before"),
        (None, (9.0,), {"run": 2}, "at = 9 s is outside run 2 of 2 of the bag"),
        (None, (0.1,), {"topic": "/rpud/jurnal"}, "/rpud/jurnal; did you mean /rpud/journal?"),
    ],
)
def test_what_the_bag_does_not_hold_is_refused(used, tmp_path, lost, words, options, reason):
    source = altered(used.path, tmp_path / "source", without_entry(lost))
    with pytest.raises(RecordingError, match=reason):
        write_fork(source, tmp_path / "fork", *words, **options)
    assert not (tmp_path / "fork").exists()


def test_a_torn_journal_is_forked_as_far_as_it_goes(used, tmp_path):
    torn = altered(used.path, tmp_path / "torn", without_entry(6))
    known = json.loads(entries_of(used.path)[5].content)["time"] / SECOND
    write_fork(torn, tmp_path / "fork", known / 2, known / 4)
    assert verify(tmp_path / "fork").proved


# --- changes of a fork, against the recorded ones ----------------------------------------------


def test_a_change_acts_exactly_at_the_instant(plain, tmp_path):
    changes = parameter_changes(
        {"weight_on_bit": 40.0, "drive_enabled": False, "regime": "free"}
    ) + parse_injections(["bias,channel=wrench,magnitude=5,duration=0.01"])
    write_fork(plain, tmp_path / "fork", 0.1234567, 0.2, changes)
    entries = entries_of(tmp_path / "fork")
    assert [e.sequence for e in entries] == list(range(len(entries)))
    made = [e for e in entries if json.loads(e.content)["time"] == 123_456_700]
    assert [e.kind for e in made] == ["stop", "configure", "weight_on_bit", "drive", "inject"]
    assert json.loads(made[2].content)["force"] == 40.0
    times = [t for t, topic, _ in held(tmp_path / "fork") if topic != JOURNAL]
    assert (min(times), max(times)) == (123_456_700, 323_456_700)


def commanded(entries, after):
    """Return times and kinds of the commands after a time [ns]."""
    found = ((json.loads(e.content)["time"], e.kind) for e in entries)
    return [each for each in found if each[0] > after and each[1] in ("weight_on_bit", "drive")]


def test_own_commands_replace_the_recorded_ones(used, tmp_path):
    (tmp_path / "commands.yaml").write_text(
        "commands:\n"
        "  - {time: 0.0055, weight_on_bit: 12}\n"
        "  - {time: 0.02, drive: {enabled: false}}\n"
        "  - {time: 0.03, drive: {voltage: 70}}\n"
        "faults:\n"
        "  - {kind: hard_rock, onset: 0.01, duration: 0.01}\n"
    )
    changes = read_commands(tmp_path / "commands.yaml")
    forked = write_fork(used.path, tmp_path / "fork", 0.02, 0.07, changes)
    found = commanded(entries_of(tmp_path / "fork"), 20 * MILLISECOND)
    assert found == [(25_500_000, "weight_on_bit"), (40_000_000, "drive"), (50_000_000, "drive")]
    with_rock = "rock_model" in manifest_of(tmp_path / "fork").parameters
    assert with_rock
    refused = [w for w in forked.warnings if "hard_rock" in w]
    assert all(w.startswith("rejected at 0.03 s: ") for w in refused)
    assert verify(tmp_path / "fork").proved


def test_the_watchdog_watches_over_own_commands(used, tmp_path):
    """40 ms after the last command of the file they are lost, and go down within 20 ms."""
    (tmp_path / "commands.yaml").write_text("commands: [{time: 0.01, weight_on_bit: 12}]")
    changes = read_commands(tmp_path / "commands.yaml")
    write_fork(used.path, tmp_path / "fork", 0.01, 0.1, changes)
    entries = entries_of(tmp_path / "fork")
    times = [time for time, kind in commanded(entries, 20 * MILLISECOND) if kind == "drive"]
    assert times[0] >= 60 * MILLISECOND
    assert (
        json.loads(next(e for e in reversed(entries) if e.kind == "drive").content)["enabled"]
        is False
    )
    assert verify(tmp_path / "fork").proved


def test_a_value_that_is_set_stays_when_the_recorded_run_changes_others(used, tmp_path):
    changes = parameter_changes({"actuator_restitution": 0.55})
    write_fork(used.path, tmp_path / "fork", 0.05, None, changes)
    recorded = [e for e in entries_of(tmp_path / "fork") if e.kind == "configure"]
    values = [json.loads(e.content)["parameters"] for e in recorded]
    assert values == [{"actuator_restitution": 0.55}, {"regime": "free"}]


def test_a_recorded_clear_finds_its_fault_under_another_number(used, tmp_path):
    """The fork has a fault more before the one that the recorded run clears."""
    recorded = next(e for e in entries_of(used.path) if e.kind == "clear")
    number = json.loads(recorded.content)["number"]
    changes = parse_injections(["restitution_loss"])
    forked = write_fork(used.path, tmp_path / "fork", 0.0001, 0.07, changes)
    assert not any("clear" in warning for warning in forked.warnings)
    [cleared] = [e for e in entries_of(tmp_path / "fork") if e.kind == "clear"]
    assert json.loads(cleared.content)["number"] == number + 1
    ended = {f.number: f for f in decoded(tmp_path / "fork", "faults")[-1].faults if not f.active}
    content = json.loads(recorded.content)
    own = ended[number + 1]
    assert (own.kind, own.channel) == (content["kind"], content["channel"])
    assert verify(tmp_path / "fork").proved


def test_a_change_at_the_instant_that_is_refused_leaves_no_bag(plain, tmp_path):
    with pytest.raises(ParameterError, match="resonance_drift is not possible"):
        write_fork(plain, tmp_path / "fork", 0.1, None, parse_injections(["resonance_drift"]))
    with pytest.raises(ParameterError, match="weight_on_bit = -1 N is outside"):
        write_fork(plain, tmp_path / "fork", 0.1, None, parameter_changes({"weight_on_bit": -1}))
    assert not (tmp_path / "fork").exists()


def test_a_later_one_is_refused_as_a_node_would(plain, tmp_path):
    (tmp_path / "f.yaml").write_text("faults: [{kind: noise, channel: wrench, onset: 0.1}]")
    forked = write_fork(plain, tmp_path / "fork", 0.15, None, read_commands(tmp_path / "f.yaml"))
    assert forked.warnings == (
        f"rejected at 0.25 s: {tmp_path / 'f.yaml'}:1: noise on wrench is already there as fault "
        + forked.warnings[0].rpartition(" ")[2],
    )
    assert verify(tmp_path / "fork").proved
