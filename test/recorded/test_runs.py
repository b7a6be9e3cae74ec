"""Runs of a bag: their plans, whose a message is, and what a bag has to hold to tell."""

import json

import numpy as np
import pytest
from altered_bags import altered, copied, edited, merged, messages_of, numbered, unchanged
from forked_runs import JOURNAL, MILLISECOND, SECOND, START, entries_of
from recorded_bags import rewritten

import rpud_sim.bag
from rpud_sim.bag import BagWriter
from rpud_sim.messages.columns import to_plain
from rpud_sim.messages.definitions import installed_codec
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.fork import write_fork
from rpud_sim.recorded.journal import UnverifiableError
from rpud_sim.recorded.output import SkippedParts
from rpud_sim.recorded.runs import find_drill, runs_of
from rpud_sim.recorded.verify import verify
from rpud_sim.simulation.topics import PROVED, TOPICS
from rpud_sim.simulation.versions import ENGINE

CODEC = installed_codec(TOPICS["journal"].type)
AHEAD = 600  # s; long enough to see that it is not simulated


def runs_in(path):
    with rpud_sim.bag.open(path) as bag:
        return runs_of(bag)


# --- whose a message is ------------------------------------------------------------------------


def test_a_message_belongs_to_the_last_run_that_had_begun_when_it_was_published(used):
    first, second = runs_in(used.path)
    begun = second.entries[0].publish_time
    times = np.array([0, begun - 1, begun, begun + 1, 2**61])
    assert first.holds(times).tolist() == [True, True, False, False, False]
    assert second.holds(times).tolist() == [False, False, True, True, True]
    assert [(run.number, run.runs, run.closed, run.incomplete) for run in (first, second)] == [
        (1, 2, True, ""),
        (2, 2, True, ""),
    ]
    assert [run.plan.beginning.initial_phase for run in (first, second)] == [0.3, 0.7]
    kinds = [change.kind for change in first.commands]
    assert kinds[:3] == ["weight_on_bit", "inject", "inject"]
    assert not {"begin", "origin", "stop", "flush", "end"} & {*kinds}
    assert (first.seed, first.parameters["initial_phase"]) == (5, 0.3)
    assert first.versions["engine"] == str(ENGINE)


def test_a_message_has_the_origin_under_which_it_was_published(used):
    first, second = runs_in(used.path)
    [place] = [e.publish_time for e in first.entries if e.entry.content.get("origin") == START + 7]
    found = first.origins(np.array([0, place - 1, place, place + 1]))
    assert found.tolist() == [START, START, START + 7, START + 7]
    assert (first.origin, second.origin) == (START + 7, START + SECOND)


def test_entries_that_come_late_or_twice_are_put_in_order(used, tmp_path):
    """As a recorder leaves them that asked the drill for those that it had missed."""
    entries = messages_of(used.path, {JOURNAL})
    middle = entries[len(entries) // 2].publish_time
    with BagWriter(tmp_path / "bag") as writer:
        copied(writer, used.path, lambda m: [] if m.topic == JOURNAL else [m.data])
        late = [m for m in entries if m.publish_time >= middle]
        early = [m for m in entries if m.publish_time < middle + 20 * MILLISECOND]
        for message in (*late, *reversed(early)):
            writer.write(JOURNAL, message.data, middle + SECOND, message.publish_time)
    found, expected = runs_in(tmp_path / "bag"), runs_in(used.path)
    assert [run.plan for run in found] == [run.plan for run in expected]
    assert [run.window for run in found] == [run.window for run in expected]
    assert verify(tmp_path / "bag").first_difference is None


def test_a_drill_that_was_killed_and_started_again_has_two_runs(bag, tmp_path):
    """Both journals count from zero, and the first one has no end."""

    def cut(message):
        return [message.data] if message.log_time < 200 * MILLISECOND else []

    altered(bag, tmp_path / "killed", cut)
    both = (tmp_path / "killed", 0, "/rpud"), (bag, 10 * SECOND, "/rpud")
    path = merged(tmp_path / "bag", *both)
    first, second = runs_in(path)
    assert (first.closed, second.closed) == (False, True)
    assert first.end == 190 * MILLISECOND
    assert second.window[0] == 10 * SECOND
    found = verify(path)
    assert found.proved
    wrenches = [m for m in messages_of(path) if m.topic == "/rpud/wrench"]
    assert found.topics["/rpud/wrench"].equal == len(wrenches) == 19 + 33


@pytest.mark.parametrize("delay", [0, 1000])
def test_several_runs_need_publishing_times(bag, tmp_path, delay):
    both = (bag, 0, "/rpud"), (bag, 10 * SECOND, "/rpud")
    path = merged(tmp_path / "bag", *both, delay=delay)
    if delay:
        assert len(runs_in(path)) == 2
        return
    with pytest.raises(UnverifiableError, match=r"cannot be decided: the bag holds 2 runs"):
        runs_in(path)
    with rpud_sim.bag.open(path) as opened:
        found = find_drill(opened, rpud_sim.recorded.output.SkippedParts(opened))
    assert (found.entries, found.runs) == ((), 1)
    assert "cannot be decided" in found.warnings[0]


def later_start(bag, folder):
    """Write a bag without the first run's beginning, but with its other entries."""
    begun = []

    def change(message):
        if message.topic == JOURNAL and CODEC.decode(message.data).kind == "begin":
            begun.append(message)
            return [message.data] if len(begun) > 1 else []
        return [message.data]

    return altered(bag, folder / "bag", change)


def test_a_journal_that_begins_with_a_later_run_proves_that_run(used, tmp_path):
    path = later_start(used.path, tmp_path)
    [run] = runs_in(path)
    assert run.plan.beginning.initial_phase == 0.7
    verification = verify(path)
    assert verification.first_difference is None
    assert verification.begins == run.entries[0].stamp
    assert verification.undecided.endswith("messages are of before the journal begins")
    assert verification.topics["/rpud/faults"].before > 0


def test_a_run_that_had_ended_when_the_recording_began_is_none_of_the_bag(used, tmp_path):
    _, second = runs_in(used.path)
    for late, number in ((-1, 2), (1, 1)):
        began = second.entries[0].publish_time + late
        records = {"rpud_recording": {"began": str(began)}}
        path = rewritten(used.path, tmp_path / str(number), records=records)
        assert len(runs_in(path)) == number
    [run] = runs_in(path)
    assert (run.number, run.entries) == (1, second.entries)
    path = rewritten(used.path, tmp_path / "odd", records={"rpud_recording": {"began": "9" * 99}})
    assert len(runs_in(path)) == 2


# --- what a journal has to hold ----------------------------------------------------------------


def beginning(edit):
    """Return a change of the content of the entry with which the run begins."""
    return edited(lambda fields, content: fields["kind"] == "begin" and edit(content))


def later_engine(content):
    content["engine"] = ENGINE + 1
    content["made_by"]["rpud_sim"] = "9.0"


def twice(message):
    fields = to_plain(CODEC.decode(message.data))
    return [message.data, CODEC.encode({**fields, "kind": "stop"})]


@pytest.mark.parametrize(
    ("change", "topics", "reason"),
    [
        (unchanged, PROVED, "holds no journal"),
        (unchanged, ["journal"], "holds nothing that /rpud/journal could prove"),
        (beginning(later_engine), None, r"rpud_sim 9\.0 reads it"),
        (numbered("journal", 1, twice), None, "entry 1 of the journal is there twice"),
        (
            numbered("journal", 0, lambda m: []),
            None,
            r"cannot be decided: 2 entries of /rpud/journal have no beginning; .* came too late",
        ),
        (beginning(lambda content: content.update(time=2**63)), None, "cannot be understood"),
        (beginning(lambda content: content.pop("parameters")), None, "it has no .parameters."),
        (edited(lambda _, content: content.pop("origin", None)), None, "it has no .origin."),
        (
            beginning(lambda c: c["parameters"].update(block_duration=0.0)),
            None,
            "block_duration = 0",
        ),
    ],
)
def test_what_cannot_be_verified_is_said(bag, tmp_path, change, topics, reason):
    held = topics and {f"/rpud/{name}" for name in topics}
    with pytest.raises(UnverifiableError, match=reason):
        verify(altered(bag, tmp_path / "bag", change, held))


def test_a_missing_entry_leaves_the_run_undecided_after_it(bag, tmp_path):
    path = altered(bag, tmp_path / "bag", numbered("journal", 1, lambda m: []))
    [run] = runs_in(path)
    assert run.incomplete == f"{JOURNAL}: entries 1 to 1 of the journal are missing"
    found = verify(path)
    assert (found.proved, found.first_difference) == (False, None)
    assert found.undecided.startswith("cannot be decided: ")


@pytest.mark.parametrize(
    ("number", "reason"),
    [
        (7, "entries 2 to 6 of the journal are missing"),
        (0, "entry 0 of the journal comes after entry 1"),
        (2**64 - 1, f"entries 2 to {2**64 - 2} of the journal are missing"),
    ],
)
def test_an_end_with_another_number_proves_nothing(bag, tmp_path, number, reason):
    def edit(fields, content):
        if fields["kind"] == "end":
            fields["sequence"] = number

    path = altered(bag, tmp_path / "bag", edited(edit))
    assert verify(path).undecided == f"cannot be decided: {JOURNAL}: {reason}"


def test_nothing_follows_the_end_of_a_run(bag, tmp_path):
    def doubled(message):
        if b"end" not in message.data or message.topic != JOURNAL:
            return [message.data]
        fields = to_plain(CODEC.decode(message.data))
        return [message.data, CODEC.encode({**fields, "sequence": fields["sequence"] + 1})]

    found = verify(altered(bag, tmp_path / "bag", doubled))
    assert (found.proved, "comes after the end, entry " in found.undecided) == (False, True)


@pytest.mark.parametrize(
    ("edit", "field"),
    [
        (lambda fields: fields["header"]["stamp"].update(nanosec=7), "header.stamp"),
        (lambda fields: fields["header"].update(frame_id="map"), "header.frame_id"),
    ],
)
@pytest.mark.parametrize("number", [0, 1, 2])
def test_an_altered_header_of_an_entry_is_a_difference(bag, tmp_path, number, edit, field):
    change = edited(lambda fields, content: fields["sequence"] == number and edit(fields))
    difference = verify(altered(bag, tmp_path / "bag", change)).first_difference
    assert (difference.topic, difference.field) == (JOURNAL, field)


# --- times that no other message shows are not run again: they might never end ------------------


def forged(path, out, kind, stamped, topics=None):
    """Put entries of a kind, and what follows, ahead; ``stamped`` alters their stamps as well."""
    ahead = 0

    def change(message):
        nonlocal ahead
        if message.topic != JOURNAL:
            return [message.data]
        fields = to_plain(CODEC.decode(message.data))
        content = json.loads(fields["content"])
        if fields["kind"] == kind:
            ahead = AHEAD
        content["time"] += ahead * SECOND
        fields["header"]["stamp"]["sec"] += ahead * stamped
        return [CODEC.encode({**fields, "content": json.dumps(content)})]

    return altered(path, out, change, topics)


@pytest.mark.parametrize("stamped", [False, True])
@pytest.mark.parametrize("kind", ["begin", "origin", "end"])
def test_a_forged_time_is_not_run_again(plain, tmp_path, kind, stamped):
    path = forged(plain, tmp_path / "bag", kind, stamped)
    entries = entries_of(path)
    number = next(n for n, entry in enumerate(entries) if entry.kind == kind)
    with pytest.raises(
        UnverifiableError, match=rf"entry {number} of the journal \({kind}\) is of "
    ):
        verify(path)
    with pytest.raises(RecordingError, match="no other message shows that time"):
        write_fork(path, tmp_path / "fork", 0.1)
    assert not (tmp_path / "fork").exists()


def test_a_time_of_a_run_before_is_not_run_again(used, tmp_path):
    path = forged(used.path, tmp_path / "bag", "flush", stamped=True)
    with pytest.raises(UnverifiableError, match="no other message shows that time"):
        verify(path)


def test_log_times_bound_a_journal_without_other_messages(used, tmp_path):
    bare = altered(used.path, tmp_path / "bare", unchanged, {JOURNAL})
    write_fork(bare, tmp_path / "fork", 0.05)
    path = forged(bare, tmp_path / "forged", "weight_on_bit", stamped=True)
    with pytest.raises(RecordingError, match="no other message shows that time"):
        write_fork(path, tmp_path / "again", 0.05)


def test_an_origin_that_contradicts_its_stamp_is_not_run_again(plain, tmp_path):
    """A bag that ends early goes on to its last stamp, from the origin on."""

    def change(message):
        if message.topic != JOURNAL:
            return [message.data]
        fields = to_plain(CODEC.decode(message.data))
        content = json.loads(fields["content"])
        if fields["kind"] == "origin":
            content["origin"] -= AHEAD * SECOND
        kept = fields["kind"] != "end"
        return [CODEC.encode({**fields, "content": json.dumps(content)})] * kept

    path = altered(plain, tmp_path / "bag", change)
    found = verify(path)
    assert (found.first_difference.field, found.simulated) == ("header.stamp", 0)
    with pytest.raises(RecordingError, match=r"header\.stamp of entry 0 is 0, not -600"):
        write_fork(path, tmp_path / "fork", 0.1)


@pytest.mark.parametrize("namespace", ["rpud", "/" + "a" * 300, "/\u00fc 'x\n\""])
def test_a_drill_is_found_in_any_namespace(used, tmp_path, namespace):
    path = merged(tmp_path / "bag", (used.path, 0, namespace))
    with rpud_sim.bag.open(path) as bag:
        assert [run.namespace for run in runs_of(bag)] == [namespace] * 2
        drill = find_drill(bag, SkippedParts(bag), namespace)
    assert (drill.namespace, drill.runs) == (namespace, 2)
