"""What a bag holds is in its files, whatever type and format, and nothing half-done stays."""

import csv
import json
import os
import resource
import subprocess
import sys
from importlib import import_module

import numpy as np
import pandas as pd
import pytest
from sample_bags import (
    SECOND,
    START,
    STRING_DEFINITION,
    TALK,
    long_waveform,
    serialized,
    write_bag,
    write_everything,
    write_offline_bag,
)

import rpud_sim.bag
from rpud_sim.bag import BagError, BagWriter, Topic
from rpud_sim.bag.metadata import LOSSES_RECORD, Losses, losses_to_record
from rpud_sim.bag.own_records import MANIFEST_RECORD as MANIFEST
from rpud_sim.bag.own_records import Manifest, manifest_from_record
from rpud_sim.recorded.export import ACCOUNT, FORMATS, export, file_stem
from rpud_sim.simulation import preset

pytestmark = pytest.mark.extended  # exports need pyarrow
READERS = {
    "parquet": lambda stem: pd.read_parquet(f"{stem}.parquet"),
    "csv": lambda stem: pd.read_csv(f"{stem}.csv"),
}


@pytest.fixture(scope="module")
def drilled(tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "bag"
    write_offline_bag(path, preset("drilling"), 0.31)
    return path


@pytest.fixture
def everything(tmp_path):
    return write_everything(tmp_path / "bag")


@pytest.mark.parametrize("file_format", FORMATS)
def test_every_format_holds_every_bit_of_the_bag(drilled, tmp_path, monkeypatch, file_format):
    monkeypatch.setattr("rpud_sim.bag.tables.BATCH_SIZE", 300_000)
    exported = export(drilled, tmp_path / "out", file_format)
    with rpud_sim.bag.open(drilled) as bag:
        assert len(list(bag.tables("/rpud/waveform"))) > 1
        for topic in exported.topics:
            found = READERS[file_format](tmp_path / "out" / file_stem(topic.name))
            expected = bag.arrays(topic.name)
            assert topic.rows == len(found["log_time"]) == len(expected["log_time"])
            for name in ("peak_force", "reacting_force", "sequence", "time", "header.stamp"):
                if name in expected:
                    values = np.asarray(found[name]).astype(expected[name].dtype)
                    assert values.tobytes() == expected[name].tobytes(), (topic, name)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {ACCOUNT, *(topic.path for topic in exported.topics)}


def test_parquet_has_units_types_and_the_kinds_of_ros(everything, tmp_path):
    export(everything, tmp_path / "out")
    pq = import_module("pyarrow.parquet")
    table = pq.read_table(tmp_path / "out" / "all.parquet")
    schema = table.schema
    kinds = {field.name: str(field.type) for field in schema}
    assert kinds["log_time"] == kinds["stamp"] == "timestamp[ns]"
    assert kinds["age"] == "duration[ns]"
    assert kinds["matrix"].startswith("fixed_size_list<")
    assert kinds["ranges"].startswith("list<")
    assert (kinds["large"], kinds["good"], kinds["note"]) == ("uint64", "bool", "string")
    assert schema.field("part.x").metadata[b"unit"] == b"m"
    assert schema.field("stamp").metadata == {b"description": b"of the reading"}
    about = json.loads(schema.metadata[b"rpud_sim"])
    assert (about["topic"], about["type"]) == ("/all", "pkg/msg/Everything")
    row = table.to_pylist()[0]
    assert row["matrix"] == [1.0, 2.0, 3.0, 4.0]
    assert row["ranges"] == [0.5, np.inf]
    assert (row["note"], row["large"], row["raw"]) == ("größer", 2**64 - 1, 200)
    assert json.loads(row["parts"]) == [{"x": 2.0, "turn": 3.0}]
    assert row["age"].value == -SECOND + 5
    assert np.isnan(row["part.turn"])
    assert pq.read_metadata(tmp_path / "out" / "none.parquet").num_rows == 0


def test_csv_has_integers_and_json(everything, tmp_path):
    export(everything, tmp_path / "out", "csv")
    frame = pd.read_csv(tmp_path / "out" / "all.csv")
    assert frame["log_time"].tolist() == [START, START + SECOND, START + 2 * SECOND]
    assert frame["large"].tolist() == [2**64 - 1] * 3
    assert json.loads(frame["ranges"][0]) == [0.5, "Infinity"]
    assert json.loads(frame["names"][0]) == ["a", "b"]
    assert len(pd.read_csv(tmp_path / "out" / "none.csv")) == 0


def test_topics_and_times_can_be_chosen(drilled, tmp_path):
    exported = export(drilled, tmp_path / "out", topics=["/rpud/wrench"], start=0.1, duration=0.1)
    [topic] = exported.topics
    assert (topic.name, topic.messages, topic.rows) == ("/rpud/wrench", 10, 10)
    times = pd.read_parquet(tmp_path / "out" / topic.path)["log_time"].astype("int64")
    assert (times.min(), times.max()) == (SECOND // 10, SECOND // 100 * 19)


def test_manifest_and_losses_are_kept(tmp_path):
    manifest = Manifest(node="/rpud/drill_node", parameters={"seed": 3})
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.add_record(LOSSES_RECORD, losses_to_record({TALK.name: Losses(2, 1)}))
        bag.add_record(MANIFEST, manifest.to_record())
    export(tmp_path / "bag", tmp_path / "out")
    pq = import_module("pyarrow.parquet")
    metadata = pq.read_schema(tmp_path / "out" / "rpud.talk.parquet").metadata
    in_file = json.loads(metadata[b"rpud_sim"])
    account = json.loads((tmp_path / "out" / ACCOUNT).read_text())
    for about in (in_file, account["tables"][TALK.name]):
        assert about["losses"] == {"transport": 2, "queue": 1, "damaged": 0}
    for about in (in_file, account):
        assert manifest_from_record(about["manifests"][0]) == manifest


def test_a_damaged_file_leaves_nothing_behind(tmp_path):
    file = write_bag(tmp_path / "bag", compression="none") / "bag_0.mcap"
    content = file.read_bytes()
    file.write_bytes(content.replace(b"message 5", b"massage 5"))
    for file_format in FORMATS:
        with pytest.raises(BagError, match=r"bag_0\.mcap"):
            export(tmp_path / "bag", tmp_path / "out", file_format)
        assert [path.name for path in tmp_path.iterdir()] == ["bag"]


EXPORT = "import sys; from rpud_sim.recorded.export import *\n"


@pytest.mark.parametrize("file_format", FORMATS)
def test_a_disk_that_is_full_is_one_error_and_leaves_nothing_behind(drilled, tmp_path, file_format):
    script = EXPORT + "try: export(*sys.argv[1:])\nexcept RecordingError as error: print(error)"
    done = subprocess.run(
        # -B: the bytecode of what it imports would be cut off as well, and stay.
        [sys.executable, "-B", "-c", script, drilled, tmp_path / "out", file_format],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
        capture_output=True,
        text=True,
    )
    assert done.stdout == f"{tmp_path / 'out'}: File too large\n", done.stderr
    assert os.listdir(tmp_path) == []


@pytest.mark.extended
def test_memory_does_not_grow_with_the_bag(tmp_path):
    """In a process of its own: most of the memory is Arrow's, which Python does not count."""
    script = EXPORT + (
        "from pathlib import Path\n"
        "export(*sys.argv[1:])\n"
        "print(int(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0]))"
    )

    def peak(count):
        bag = long_waveform(tmp_path / str(count), count)
        command = [sys.executable, "-c", script, bag, tmp_path / f"out{count}"]
        return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

    small, large = map(peak, (40_000_000, 120_000_000))
    assert large < small + 24_000  # KiB
    assert large < 600_000


def test_a_text_that_a_spreadsheet_would_take_for_a_formula_is_none(tmp_path):
    definition = "string text\nfloat64 number\n"
    texts = ["=1+1", "+1", "-1", "@SUM(A1)", "\tx", "\rx", "'x", "a=1", ""]
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(Topic("/a", "pkg/msg/Cell"), definition)
        for text in texts:
            values = {"text": text, "number": -1.5}
            bag.write("/a", serialized("pkg/msg/Cell", definition, values), START, START)
    export(tmp_path / "bag", tmp_path / "csv", "csv")
    with (tmp_path / "csv" / "a.csv").open(newline="", encoding="utf-8") as file:
        rows = [*csv.DictReader(file)]
    assert [row["text"] for row in rows] == [f"'{text}" for text in texts[:6]] + texts[6:]
    assert {row["number"] for row in rows} == {"-1.5"}
    export(tmp_path / "bag", tmp_path / "parquet")
    assert [*pd.read_parquet(tmp_path / "parquet" / "a.parquet")["text"]] == texts


@pytest.mark.parametrize("file_format", FORMATS)
def test_hostile_names_of_topics_are_plain_names_in_the_folder(tmp_path, file_format):
    names = ["../../out", "/a/../../b", "/x\0y", "C:\\x", "/a b", "/", "a" * 3000, "/fine"]
    with BagWriter(tmp_path / "bag") as bag:
        for name in names:
            bag.add_topic(Topic(name, TALK.type), STRING_DEFINITION)
    exported = export(tmp_path / "bag", tmp_path / "out", file_format)
    assert len({topic.path for topic in exported.topics}) == len(names)
    found = {path.name for path in (tmp_path / "out").iterdir()}
    assert found == {ACCOUNT, *(topic.path for topic in exported.topics)}
    assert not set("".join(found)) & set("/\\\0: ")
    assert {path.name for path in tmp_path.iterdir()} == {"bag", "out"}
