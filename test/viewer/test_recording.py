"""Bags as they come: damaged, empty, read in parts, with several runs and drills."""

from contextlib import closing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_bags import SECOND, ForceRecorder, frame_of, rows_of, write_forces
from sample_bags import write_bag

from rpud_sim.messages.batch import Batch
from rpud_sim.recorded.runs import RecordedEntry, RecordedRun
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.plan import Beginning, JournalEntry
from rpud_sim.viewer import recording as recordings
from rpud_sim.viewer.recorded import RecordedStore
from rpud_sim.viewer.recording import RecordedBag, TimeLine

STEP = 10_000_000


def times_of(recording):
    """Return the times since the bag began of all messages, chunk by chunk [s]."""
    found = [
        each.times / SECOND
        for number in range(len(recording.chunks))
        for each in recording.signals_in(number)
    ]
    return np.sort(np.concatenate(found))


def test_a_damaged_chunk_is_skipped_and_reported(tmp_path):
    path = write_forces(tmp_path / "bag", rows_of(200), chunk_size=2000)
    with closing(RecordedBag(path)) as recording:
        whole = len(times_of(recording))
    file = next(path.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 40] = bytes(40)
    file.write_bytes(data)
    with closing(RecordedBag(path)) as recording:
        assert whole // 2 < len(times_of(recording)) < whole
        assert 1 <= len(recording.damages) <= 2
    frame = frame_of(path)
    assert "damaged parts are skipped" in frame["notice"]
    assert frame["read"] == 1.0


def test_an_empty_bag_and_one_without_numbers_are_shown_as_such(tmp_path):
    for path in (write_forces(tmp_path / "empty", []), write_bag(tmp_path / "text")):
        frame = frame_of(path)
        assert "no numbers" in frame["notice"]
        assert frame["read"] == 1.0


@pytest.mark.parametrize("rate", [0.25, 1.0, 7.0])
def test_parts_of_a_range_are_found_also_where_time_passes_at_another_speed(tmp_path, rate):
    slow = [(int(log / rate), stamp, value) for log, stamp, value in rows_of(3000, stamp=SECOND)]
    with closing(RecordedBag(write_forces(tmp_path / "bag", slow, chunk_size=2000))) as recording:
        for start, end in ((0.0, 0.05), (7.0, 7.2), (29.0, 29.99)):
            values = np.concatenate(
                [
                    each.fields["force"]
                    for number in recording.chunks_between("/rpud", start, end)
                    for each in recording.signals_in(number)
                ]
            )
            wanted = np.arange(np.ceil(start * 100 - 1e-6), np.floor(end * 100 + 1e-6) + 1)
            assert set(wanted) <= set(values)
            assert len(values) < len(wanted) + 400


def forces(values):
    return [(number * STEP, number * STEP, value) for number, value in enumerate(values)]


def seen(store, parts=1000):
    """Return the envelope of the force."""
    (drill,) = store.histories.values()
    (signal,) = [each for each in drill.own_signals if each.column == "force"]
    return store.reading.bins.view(signal.name, 0.0, drill.time, parts)


@pytest.mark.parametrize("sampled", [1, 5])
def test_each_value_counts_once_and_a_part_is_never_called_the_whole(
    tmp_path, monkeypatch, sampled
):
    monkeypatch.setattr(recordings, "SAMPLED", sampled)
    values = np.random.default_rng(1).normal(size=500)
    with RecordedStore(write_forces(tmp_path / "bag", forces(values))) as store:
        while not store.reading.complete:
            assert store.reading.share < 1.0
            assert store.reading.gaps() == []
            shown = seen(store)
            assert set(shown["low"][np.isfinite(shown["low"])]) <= set(values)
            store.reading.read_next()
        assert store.reading.share == 1.0
        envelope = seen(store, 1)
        assert (envelope["low"].min(), envelope["high"].max()) == (values.min(), values.max())
        part = np.searchsorted(np.arange(500) * 0.01, envelope["t"][0])
        assert envelope["mean"][0] == pytest.approx(values[: 2 * part].mean(), abs=0.05)


def test_gaps_are_where_messages_are_missing(tmp_path):
    rows = [row for row in forces(np.ones(1000)) if not 3 * SECOND < row[0] < 5 * SECOND]
    with RecordedStore(write_forces(tmp_path / "bag", rows)) as store:
        store.read_all()
        ((start, end),) = store.reading.gaps()
        assert abs(start - 3.0) < 0.02
        assert abs(end - 5.0) < 0.02


def test_a_run_after_a_reset_follows_the_one_before(tmp_path):
    """Twenty seconds, after twelve of which stamps begin again."""
    recorder = ForceRecorder(tmp_path / "bag", 4000)
    begin = Beginning(Settings()).to_journal()
    recorder.tell(0, "begin", 0, 0, **begin)
    recorder.write([(number * STEP, number * STEP, float(number)) for number in range(1200)])
    reset = 1200 * STEP
    recorder.tell(reset, "flush", reset, reset)
    recorder.tell(reset + 1, "begin", 0, 0, **begin)
    recorder.write([(reset + 1 + n * STEP, n * STEP, 1200.0 + n) for n in range(800)])
    recorder.tell(reset + 800 * STEP, "end", 800 * STEP, 800 * STEP)
    recorder.close()
    with RecordedStore(recorder.path) as store:
        store.read_all()
        shown = seen(store)
        valid = np.isfinite(shown["mean"])
        assert np.abs(shown["mean"][valid] - 100.0 * shown["t"][valid]).max() < 10.0
    log = frame_of(recorder.path)["log"]
    assert [(each["time"], each["text"]) for each in log] == [
        (0.0, "a run begins"), (12.0, "a run begins"), (20.0, "the drill stops"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "entries",
    [
        [("weight_on_bit", {"force": 3.0})],
        [
            ("begin", Beginning(Settings()).to_journal()),
            *(("origin", {"origin": origin}) for origin in (0, -(10**30))),
        ],
    ],
)
def test_a_journal_that_shows_no_runs_is_named(tmp_path, entries):
    recorder = ForceRecorder(tmp_path / "bag")
    for number, (kind, content) in enumerate(entries):
        recorder.tell(number, kind, 0, 0, **content)
    recorder.write([(number + 1, stamp, force) for number, stamp, force in rows_of(100, SECOND)])
    recorder.close()
    frame = frame_of(recorder.path)
    assert "Its runs are not known" in frame["notice"]
    assert frame["now"] == pytest.approx(0.99)


def run_of(number, entries, window, end):
    """Return a run of entries: kind, stamp, simulation time and publishing time."""
    found = tuple(
        RecordedEntry(JournalEntry(n, time, kind, {"origin": stamp - time}), stamp, "", sent, sent)
        for n, (kind, stamp, time, sent) in enumerate(entries)
    )
    return RecordedRun("bag", "/rpud/journal", number, 2, found, window, end)


def origins_of(line, published):
    """Return numbers of runs and origins that a time line gives to messages of these times."""
    none = np.zeros(len(published), np.int64)
    parts = [*line.place(Batch("", np.array(published), starts=none, sizes=none))]
    return [(part.run, part.origin) for part in parts for _ in range(len(part))]


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["pause", "begin", "stamps"]),
            st.integers(2, 10 * SECOND),  # of simulation time
            st.integers(1, 100 * SECOND),  # of real time, in which the drill stands
        ),
        max_size=8,
    )
)
def test_time_goes_on_as_that_of_the_simulation(changes):
    origin = published = begun = 1_700_000_000 * SECOND
    now = passed = 0
    entries, runs, stamps, sent, expected = [("begin", origin, 0, published)], [], [], [], []
    entries.append(("origin", origin, 0, published))
    for kind, length, stands in [*changes, ("begin", 2, 1)]:
        for part in (0, length // 2, length):
            stamps.append(origin + now + part)
            sent.append(published + part)
            expected.append(passed + part)
        now, published, passed = now + length, published + length + stands, passed + length
        if kind == "begin":
            runs.append(run_of(len(runs) + 1, entries, (begun, published - 1), now))
            now, origin, begun, entries = 0, published, published, []
        elif kind == "pause":
            origin += stands
        else:
            origin = -now
        entries += [(each, origin + now, now, published) for each in ("begin", "origin")]
    line = TimeLine(runs, stamps[0], sent[0], 0)
    origins = [origin for _, origin in origins_of(line, sent)]
    assert (np.array(stamps) - origins).tolist() == expected


def test_a_late_recording_begins_at_zero_and_what_came_before_its_first_run_is_shown():
    whole = run_of(1, [("begin", 0, 0, 0), ("origin", 0, 0, 0)], (0, 500), 500)
    last = run_of(2, [("begin", 7, 0, 501), ("origin", 7, 0, 501)], (501, 2**62), 90)
    late = TimeLine([whole, last], 47, 541, 0)
    assert origins_of(late, [541]) == [(0, 47)]
    torn = TimeLine([last], 400, 401, 0)  # the beginning of its first run is missing
    assert origins_of(torn, [401, 501]) == [(0, 400), (1, 7 - 100)]


def test_recorded_commands_are_no_drill_beside_the_drill(tmp_path):
    recorder = ForceRecorder(tmp_path / "bag")
    recorder.write(rows_of(200))
    recorder.write(rows_of(200), "/rpud/command/force")
    recorder.close()
    assert frame_of(recorder.path)["drills"] == ["/rpud"]


@pytest.mark.parametrize("topic", ["/rpud/thermal", "/rpud/supervisor/state", "/arm/state"])
def test_a_stamp_of_another_program_moves_neither_the_clock_nor_the_end(tmp_path, topic):
    recorder = ForceRecorder(tmp_path / "bag")
    recorder.write([(0, 0, 7.0)], topic)
    recorder.write([(n + 1, 1_790_000_000 * SECOND + n, f) for n, _, f in rows_of(200)])
    fitting = [(n, 1_790_000_000 * SECOND + n, 9.0) for n, _, _ in rows_of(150)]
    recorder.write([*fitting, (SECOND, 1_990_000_000 * SECOND, 8.0)], topic)
    recorder.close()
    with RecordedStore(recorder.path) as store:
        store.read_all()
        shown = store.reading.bins.view(f"{topic} force", 0.0, 2.0, 100)
        drill = store.histories["/rpud"]
        near = drill.view(0.0, 1.0, 500, {f"{topic} force": "line"})["layers"]
    frame = frame_of(recorder.path)
    assert (frame["drills"], frame["now"]) == (["/rpud"], pytest.approx(1.99))
    assert set(shown["mean"][np.isfinite(shown["mean"])]) == {9.0}
    assert np.abs(near[f"{topic} force"]["t"]).max() < 2.0
    assert f"Stamps outside the run, not drawn: 2 of {topic}." in frame["notice"]
