"""MCAP bags of ``ros2 bag record`` are read; for others one line names what converts them."""

import shlex
import sys
from importlib.metadata import entry_points

import pytest
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability
from rosbags.interfaces import QosTime as Span
from rosbags.rosbag1 import Writer as BagOfRos1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from sample_bags import START, STRING, STRING_DEFINITION, STRING_HASH, serialized_string

import rpud_sim.bag
from rpud_sim.bag import BagFormatError
from rpud_sim.bag.recovery import recover

FOREVER = Span(9223372036, 854775807)
OFFER = Qos(
    QosHistory.KEEP_LAST,
    7,
    QosReliability.BEST_EFFORT,
    QosDurability.TRANSIENT_LOCAL,
    FOREVER,
    Span(0, 5),
    QosLiveliness.AUTOMATIC,
    FOREVER,
    False,
)


def write(path, storage, mode):
    """Write messages on two topics with another library and return the path."""
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        talk, chat = (
            writer.add_connection(
                name,
                STRING,
                msgdef=STRING_DEFINITION,
                rihs01=STRING_HASH,
                offered_qos_profiles=offers,
            )
            for name, offers in (("/talk", [OFFER]), ("/chat", []))
        )
        for number in range(10):
            data = serialized_string(f"message {number}")
            writer.write(chat if number % 5 == 4 else talk, START + number, data)
    return path


@pytest.mark.parametrize(
    ("mode", "compression"), [(CompressionMode.NONE, "none"), (CompressionMode.STORAGE, "zstd")]
)
def test_mcap_is_read_with_its_offers_and_recovered(tmp_path, mode, compression):
    path = write(tmp_path / "run", StoragePlugin.MCAP, mode).rename(tmp_path / "a run 100%?#")
    with rpud_sim.bag.open(path) as bag:
        messages = list(bag.messages())
        assert [each.data for each in messages] == [
            serialized_string(f"message {number}") for number in range(10)
        ]
        assert [each.log_time for each in messages] == [START + number for number in range(10)]
        chat, talk = bag.topics
        assert (chat.message_count, chat.first_time, chat.last_time) == (2, START + 4, START + 9)
        assert (talk.topic.type, talk.definition) == (STRING, STRING_DEFINITION)
        [offer] = talk.topic.offered_qos
        assert (offer.depth, offer.reliability, offer.lifespan) == (7, "best_effort", 5)
        assert bag.compression == compression
    (path / "metadata.yaml").unlink()
    for place in (path, *path.iterdir()):
        with rpud_sim.bag.open(place) as bag:
            assert [*bag.messages()] == messages
    assert recover(path, tmp_path / "out").message_count == 10


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    ],
)
def test_the_line_of_another_storage_names_what_makes_a_bag_of_it(
    tmp_path, monkeypatch, storage, mode
):
    path = write(tmp_path / "run", storage, mode)
    for read in (rpud_sim.bag.open, lambda place: recover(place, tmp_path / "out")):
        with pytest.raises(BagFormatError, match="rosbags-convert") as caught:
            read(path)
    convert(monkeypatch, str(caught.value), tmp_path / "new")
    with rpud_sim.bag.open(tmp_path / "new") as bag:
        assert bag.message_count == 10
    assert not (tmp_path / "out").exists()


def convert(monkeypatch, line, out):
    """Carry out the remedy that a line names, in this process."""
    words = shlex.split(line[line.index("rosbags-convert") :].partition(" (")[0])
    words[words.index("NEW")] = str(out)
    monkeypatch.setattr(sys, "argv", words)
    [program] = entry_points(group="console_scripts", name=words[0])
    with pytest.raises(SystemExit) as end:
        sys.exit(program.load()())
    assert not end.value.code


def test_of_a_bag_of_ros_1_the_line_names_what_converts_it(tmp_path, monkeypatch):
    types = get_typestore(Stores.ROS1_NOETIC)
    with BagOfRos1(tmp_path / "run.bag") as writer:
        connection = writer.add_connection("/a", STRING, typestore=types)
        message = types.types[STRING](data="hi")
        writer.write(connection, START, types.serialize_ros1(message, STRING))
    with pytest.raises(BagFormatError, match="is a bag of ROS 1") as caught:
        rpud_sim.bag.open(tmp_path / "run.bag")
    convert(monkeypatch, str(caught.value), tmp_path / "new")
    with rpud_sim.bag.open(tmp_path / "new") as bag:
        assert bag.arrays("/a")["data"].tolist() == ["hi"]


@pytest.mark.parametrize(
    ("name", "start", "remedy"),
    [
        ("run.zip", b"PK\x03\x04", "unzip {}"),
        ("run.tar", bytes(257) + b"ustar", "tar xf {}"),
        ("run.tar.gz", b"\x1f\x8b", "tar xzf {} or gunzip {}"),
        ("run.mcap.zstd", b"\x28\xb5\x2f\xfd", "zstd -d {}"),
        ("run.db3", b"SQLite format 3\0", "ros2 bag reindex -s sqlite3 {folder}"),
    ],
)
def test_an_archive_is_one_line_that_names_what_unpacks_it(tmp_path, name, start, remedy):
    path = tmp_path / "a bag" / name
    path.parent.mkdir()
    path.write_bytes(start + bytes(600))
    for place in (path, path.parent):
        for read in (rpud_sim.bag.open, lambda place: recover(place, tmp_path / "out")):
            with pytest.raises(BagFormatError) as caught:
                read(place)
            quoted, folder = f"'{path}'", f"'{path.parent}'"
            assert remedy.format(quoted, quoted, folder=folder) in str(caught.value)
