"""A bag of several files is one bag for rosbag2's readers and for those of this project."""

import os

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from sample_bags import SECOND, START, STRING_DEFINITION, TALK, serialized_string

import rpud_sim.bag
from rpud_sim.bag import BagWriter
from rpud_sim.bag.recovery import recover


def write(path, count=100, **options):
    """Write ``count`` messages on TALK, 100 a second."""
    with BagWriter(path, **options) as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        for number in range(count):
            time = START + number * SECOND // 100
            text = f"{number:04} " + "x" * 200
            bag.write(TALK.name, serialized_string(text), time, time - 5)
    return path


def talk(bag):
    return [int(message.data[8:12]) for message in bag.messages([TALK.name])]


def test_by_duration_every_file_is_whole(tmp_path):
    path = write(tmp_path / "run", max_file_duration=0.25)
    document = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    names = [f"run_{number}.mcap" for number in range(4)]
    assert sorted(os.listdir(path)) == ["metadata.yaml", *names]
    assert document["relative_file_paths"] == names
    assert [file["path"] for file in document["files"]] == names
    assert [file["message_count"] for file in document["files"]] == [25, 25, 25, 25]
    for name, file in zip(names, document["files"], strict=True):
        with (path / name).open("rb") as stream:
            statistics = make_reader(stream, validate_crcs=True).get_summary().statistics
        begin = file["starting_time"]["nanoseconds_since_epoch"]
        assert begin == statistics.message_start_time
        assert begin + file["duration"]["nanoseconds"] == statistics.message_end_time
    with AnyReader([path]) as reader:
        assert reader.message_count == 100
    with rpud_sim.bag.open(path / "run_2.mcap") as bag:
        assert talk(bag) == list(range(50, 75))


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_by_size_no_file_is_larger(tmp_path, compression):
    path = write(
        tmp_path / "run", 1000, max_file_size=40_000, compression=compression, chunk_size=2000
    )
    sizes = [file.stat().st_size for file in path.glob("*.mcap")]
    assert len(sizes) > 3
    assert max(sizes) <= 40_000
    with rpud_sim.bag.open(path) as bag:
        assert bag.compression == compression
        assert talk(bag) == list(range(1000))
        assert bag.message_count == len(list(bag.messages())) == 1000


def test_a_torn_one_is_recovered_into_one_file(tmp_path):
    path = write(tmp_path / "run", 300, max_file_duration=0.25)
    (path / "metadata.yaml").unlink()
    with rpud_sim.bag.open(path) as bag:  # files are in the order of their numbers
        assert bag.message_count == 300
        assert talk(bag) == list(range(300))
    last = path / "run_11.mcap"
    last.write_bytes(last.read_bytes()[:-20])
    with pytest.raises(rpud_sim.bag.BagFormatError, match=r"run_11\.mcap is cut off"):
        rpud_sim.bag.open(path)
    recovery = recover(path, tmp_path / "whole")
    assert not recovery.closed
    assert recovery.topics[TALK.name].recovered == 300
    assert not any(topic.lost for topic in recovery.topics.values())
    with rpud_sim.bag.open(tmp_path / "whole") as bag:
        assert talk(bag) == list(range(300))
