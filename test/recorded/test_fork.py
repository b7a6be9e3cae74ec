"""A recorded run goes on from any instant bit for bit, or the reason is named why it cannot."""

import json
import tempfile
from pathlib import Path

import pytest
from altered_bags import altered, numbered
from hypothesis import given, settings
from hypothesis import strategies as st
from inspection.forked_runs import (
    JOURNAL,
    MILLISECOND,
    SCENARIO,
    SECOND,
    entries_of,
    held,
    manifest_of,
)
from rpud_sim.recorded.verify.verification import verify
from rpud_sim.simulation.plans import parameter_changes
from sample_bags import write_offline_bag

from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.offline_bag import write_fork
from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario_file import parse_injections
from rpud_sim.simulation.topics import TOPICS


@settings(max_examples=8, deadline=None)
@given(place=st.floats(0.0, 1.0, exclude_max=True), run=st.integers(1, 2))
def test_without_a_change_it_is_the_rest_of_the_run(used, place, run):
    path, published = used.path, used.published
    times = [time for number, time, _, _ in published if number == run]
    time = int(place * max(times))
    with tempfile.TemporaryDirectory() as folder:
        write_fork(path, Path(folder, "fork"), time / SECOND, run=run)
        origin = min(t for t, _, _ in held(Path(folder, "fork")))
        found = [each for each in held(Path(folder, "fork")) if each[0] > origin]
    for topic in (f"/rpud/{name}" for name in TOPICS if name != "status"):
        rest = [data for n, t, name, data in published if (n, name) == (run, topic) and t > time]
        forked = [data for _, name, data in found if name == topic]
        if run == 1 and topic == JOURNAL:  # it ended by a reset, and its fork by itself
            rest, forked = rest[:-1], forked[:-1]
        assert forked == rest, topic


@settings(max_examples=8, deadline=None)
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


@pytest.mark.parametrize("at", [0.0, 0.0567, 0.1])
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
    write_fork(tmp_path / "fork", tmp_path / "again", time / SECOND, run=run)
    assert verify(tmp_path / "again").proved
    begin = min(t for t, _, _ in held(tmp_path / "again"))
    rest = [each for each in held(tmp_path / "again") if each[0] > begin]
    assert rest == [each for each in held(tmp_path / "fork") if each[0] > begin]


def test_it_names_where_it_came_from(plain, tmp_path):
    changes = parse_injections(["restitution_loss,duration=0.1"]) + parameter_changes(
        {"weight_on_bit": 30}
    )
    write_fork(plain, tmp_path / "fork", 0.1, 0.05, changes)
    origin = manifest_of(tmp_path / "fork").forked_from
    assert (origin["bag"], origin["run"], origin["at"]) == (str(plain), 1, 0.1)
    assert len(origin["journal"]) == 64
    assert origin["changes"]["parameters"] == {"weight_on_bit": 30}
    (planned,) = origin["changes"]["planned"]
    assert planned["delay"] == 0.0
    assert planned["Injection"]["fault"]["kind"] == "restitution_loss"
    assert manifest_of(plain).forked_from == {}


def test_it_may_go_on_beyond_the_end_of_the_recorded_run(plain, tmp_path):
    forked = write_fork(plain, tmp_path / "fork", 0.3, 0.2)
    assert forked.duration == pytest.approx(0.2)
    assert verify(tmp_path / "fork").proved
    whole = tmp_path / "whole"
    write_offline_bag(whole, preset("drilling"), 0.5, 0.2, SCENARIO, 11)
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
        (None, (9.0,), {"run": 2}, "--at = 9 s is outside run 2 of 2 of the bag"),
        (None, (0.1,), {"topic": "/rpud/jurnal"}, "named /rpud/jurnal, but /rpud/journal"),
    ],
)
def test_what_the_bag_does_not_hold_is_refused(used, tmp_path, lost, words, options, reason):
    source = altered(used.path, tmp_path / "source", without_entry(lost))
    with pytest.raises(RecordingError, match=reason):
        write_fork(source, tmp_path / "fork", *words, **options)
    assert not (tmp_path / "fork").exists()


def test_a_journal_without_its_beginning_is_refused(plain, tmp_path):
    late = altered(plain, tmp_path / "late", without_entry(0))
    with pytest.raises(RecordingError, match=r"/rpud/journal: .*; its recorder came too late"):
        write_fork(late, tmp_path / "fork", 0.01)


def test_a_torn_journal_is_forked_as_far_as_it_goes(used, tmp_path):
    torn = altered(used.path, tmp_path / "torn", without_entry(6))
    known = json.loads(entries_of(used.path)[5].content)["time"] / SECOND
    write_fork(torn, tmp_path / "fork", known / 2, known / 4)
    assert verify(tmp_path / "fork").proved
