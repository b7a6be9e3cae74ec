"""Bags of ``ros2 bag record`` are read: plain MCAP, compressed, and SQLite."""

import contextlib
import sqlite3

import pytest
import zstandard
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability
from rosbags.interfaces import QosTime as Span
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from sample_bags import (
    START,
    STRING,
    STRING_DEFINITION,
    STRING_HASH,
    rewrite,
    serialized_string,
)

import rpud_sim.bag
from rpud_sim.bag import BagFormatError
from rpud_sim.bag.definitions import find_definition
from rpud_sim.bag.messages import messages_of
from rpud_sim.bag.recovery import recover

COMPRESSION = {
    CompressionMode.NONE: "none",
    CompressionMode.STORAGE: "zstd",
    CompressionMode.FILE: "zstd files",
    CompressionMode.MESSAGE: "zstd messages",
}
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
PLAIN = [(StoragePlugin.MCAP, CompressionMode.NONE), (StoragePlugin.MCAP, CompressionMode.STORAGE)]
kinds = pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (storage, mode)
        for storage in StoragePlugin
        for mode in CompressionMode
        if (storage, mode) != (StoragePlugin.SQLITE3, CompressionMode.STORAGE)
    ],
)


def read_all(path):
    """Read the topics and messages of a bag."""
    with rpud_sim.bag.open(path) as bag:
        assert bag.topics
        list(bag.messages())


def write(path, storage, mode, count=10):
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
        for number in range(count):
            data = serialized_string(f"message {number}")
            writer.write(chat if number % 5 == 4 else talk, START + number, data)
    return path


@kinds
def test_every_way_to_record_is_read(tmp_path, storage, mode):
    path = write(tmp_path / "run", storage, mode).rename(tmp_path / "a run 100%?#")
    with rpud_sim.bag.open(path) as bag:
        messages = list(bag.messages())
        assert [each.data for each in messages] == [
            serialized_string(f"message {number}") for number in range(10)
        ]
        assert [each.log_time for each in messages] == [START + number for number in range(10)]
        assert [each.log_time for each in bag.messages(["/chat"], start=5)] == [START + 9]
        assert (bag.message_count, bag.start_time, bag.duration) == (10, START, 9)
        assert bag.size == sum(
            file.stat().st_size for file in path.iterdir() if file.suffix != ".yaml"
        )
        each = [m for segment in bag.segments() for m in messages_of([*segment.blocks(None)])]
        assert each == messages
        chat, talk = bag.topics
        assert (chat.message_count, chat.first_time, chat.last_time) == (2, START + 4, START + 9)
        assert talk.topic.type == STRING
        assert talk.topic.type_hash == (STRING_HASH if storage is StoragePlugin.SQLITE3 else "")
        assert talk.definition == STRING_DEFINITION
        [offer] = talk.topic.offered_qos
        assert (offer.depth, offer.reliability, offer.lifespan) == (7, "best_effort", 5)
        assert bag.arrays("/talk")["data"][0] == "message 0"
        assert bag.compression == COMPRESSION[mode]
    if mode is CompressionMode.MESSAGE:
        return  # only the metadata says so
    (path / "metadata.yaml").unlink()
    [file] = path.iterdir()
    for place in (path, file):
        with rpud_sim.bag.open(place) as bag:
            assert [*bag.messages()] == messages


@kinds
def test_recovery_takes_plain_files_and_names_what_converts_others(tmp_path, storage, mode):
    path = write(tmp_path / "run", storage, mode)
    if (storage, mode) in PLAIN:
        assert recover(path, tmp_path / "out").message_count == 10
        return
    for place in (path, *path.glob("*.zstd")):
        with pytest.raises(BagFormatError, match="ros2 bag convert") as caught:
            recover(place, tmp_path / "out")
        assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_segments_of_a_database_have_so_many_messages_also_after_a_jump_of_the_clock(tmp_path):
    with edited(tmp_path / "run", 2500) as (_, database):
        database.execute("UPDATE messages SET timestamp = 9223372036854775807 WHERE id > 2499")
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        parts = [sum(map(len, segment.blocks(None))) for segment in bag.segments()]
        assert sum(parts) == sum(1 for _ in bag.messages()) == 2500
    assert len(parts) >= 3
    assert max(parts) <= 1000


def test_uncompressed_files_are_gone_with_the_reader(tmp_path, monkeypatch):
    path = write(tmp_path / "run", StoragePlugin.MCAP, CompressionMode.FILE)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    with rpud_sim.bag.open(path):
        assert any(temporary.iterdir())
    assert not any(temporary.iterdir())
    [file] = path.glob("*.zstd")
    file.write_bytes(zstandard.compress(b"no bag"))
    with pytest.raises(BagFormatError, match=r"run\.mcap\.zstd is not an MCAP file"):
        rpud_sim.bag.open(path)
    assert not any(temporary.iterdir())


def test_the_limit_is_that_of_all_files_together(tmp_path, monkeypatch):
    monkeypatch.setattr("rpud_sim.bag.storage_files._LEAST_LIMIT", 2**20)
    plain = write(tmp_path / "plain", StoragePlugin.MCAP, CompressionMode.NONE, count=10_000)
    [file] = plain.glob("*.mcap")
    size = file.stat().st_size
    assert 2**19 < size < 2**20
    for number in range(2):
        (tmp_path / f"run_{number}.mcap.zstd").write_bytes(zstandard.compress(file.read_bytes()))
    monkeypatch.setattr("rpud_sim.bag.storage_files._MOST_GROWTH", 0)
    with pytest.raises(BagFormatError, match=f"run_1.*more than {2**20 - size} bytes"):
        rpud_sim.bag.open(tmp_path)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"no frame at all",
        zstandard.compress(bytes(99))[:-3],
        b"\x28\xb5\x2f\xfd\xe0" + b"\xff" * 8,
    ],
)
def test_a_message_that_cannot_be_uncompressed_is_one_line(tmp_path, data):
    with edited(tmp_path / "run") as (_, database):
        database.execute("UPDATE messages SET data = ?", [data])
    for key, value in (("mode", "MESSAGE"), ("format", "zstd")):
        old = f"compression_{key}: "
        rewrite(tmp_path / "run" / "metadata.yaml", f"{old}''", f"{old}{value}")
    with (
        rpud_sim.bag.open(tmp_path / "run") as bag,
        pytest.raises(BagFormatError, match=r"/(talk|chat): a ") as caught,
    ):
        list(bag.messages())
    assert "\n" not in str(caught.value)


@contextlib.contextmanager
def edited(path, count=10):
    """Write an SQLite bag, and yield its file and its database."""
    [file] = write(path, StoragePlugin.SQLITE3, CompressionMode.NONE, count).glob("*.db3")
    with contextlib.closing(sqlite3.connect(file)) as database, database:
        yield file, database


_MESSAGES = (
    "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, "
)
_STRANGE = r"essage.* has content that is not stored in it"


@pytest.mark.parametrize(
    ("statement", "complaint"),
    [
        (
            "UPDATE messages SET timestamp = 'soon' WHERE id = 2",
            "the time 'soon' and blob data; times are integers from 0",
        ),
        ("UPDATE messages SET timestamp = -1", "the time -1 and"),
        (
            f"{_MESSAGES} data); INSERT INTO messages VALUES(1, 1, 5, x''), (2, 1, 6.5, x'');"
            "INSERT INTO messages VALUES(3, 1, 7, x'')",
            "the time 6.5 and blob data",
        ),
        (
            f"{_MESSAGES} data); INSERT INTO messages VALUES(1, 1, 5, x''), (2, 1, NULL, x'')",
            "the time None and blob data",
        ),
        ("UPDATE messages SET data = 'text'", "text data; .* data is a blob"),
        ("UPDATE topics SET name = x'ff'", "a topic has a name, type or format that is no text"),
        ("UPDATE topics SET name = CAST(x'ff' AS TEXT)", "damaged"),
        ("UPDATE topics SET offered_qos_profiles = '[1]'", "a profile of offered_qos_profiles"),
        ("UPDATE topics SET offered_qos_profiles = '[&a 1, *a]'", "has aliases"),
        ("DROP TABLE topics", "no such table: topics"),
        (
            "CREATE TABLE copy AS SELECT * FROM topics UNION ALL SELECT * FROM topics;"
            "DROP TABLE topics; ALTER TABLE copy RENAME TO topics",
            "2 topics have the number 1",
        ),
        (
            f"{_MESSAGES} data AS (zeroblob(1e8))); INSERT INTO messages(topic_id) VALUES(1);",
            _STRANGE,
        ),
        (f"{_MESSAGES} data DEFAULT x'00'); INSERT INTO messages(topic_id) VALUES(1);", _STRANGE),
        (
            "DROP TABLE message_definitions; CREATE VIEW Message_Definitions AS SELECT 1",
            _STRANGE,
        ),
    ],
)
def test_a_database_that_is_no_bag_is_one_line(tmp_path, statement, complaint):
    with edited(tmp_path / "run") as (file, database):
        database.executescript(statement)
    with pytest.raises(BagFormatError, match=complaint) as caught:
        read_all(tmp_path / "run")
    assert "\n" not in str(caught.value)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    ("statement", "definition"),
    [  # of a bag before Iron, and of a recorder that did not find it
        ("DROP TABLE message_definitions", find_definition(STRING)),
        ("UPDATE message_definitions SET encoding = 'unknown'", None),
    ],
)
def test_a_database_without_a_definition_is_read(tmp_path, statement, definition):
    with edited(tmp_path / "run") as (_, database):
        database.execute(statement)
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert [topic.definition for topic in bag.topics] == [definition] * 2
        assert sum(1 for _ in bag.messages()) == 10


@pytest.mark.parametrize(
    ("column", "table", "kind"),
    [
        ("data", "messages", "BLOB"),
        ("data", "messages", "TEXT"),
        ("name", "topics", "TEXT"),
        ("encoded_message_definition", "message_definitions", "TEXT"),
    ],
)
def test_content_larger_than_its_database_is_refused_before_it_is_read(
    tmp_path, column, table, kind
):
    with edited(tmp_path / "run") as (file, database):
        (size,) = database.execute("PRAGMA page_size").fetchone()
        (pages,) = database.execute("PRAGMA page_count").fetchone()
        database.execute("DELETE FROM messages WHERE id > 1")
        database.execute(
            f"UPDATE {table} SET {column} = CAST(zeroblob(10000000) AS {kind}) WHERE id = 1"
        )
    # Without the pages of the large content, whose length its row still has.
    content = bytearray(file.read_bytes()[: pages * size])
    content[28:32] = pages.to_bytes(4, "big")
    file.write_bytes(content)
    with pytest.raises(
        BagFormatError, match=f"{table} have more than the file's {pages * size} bytes"
    ):
        rpud_sim.bag.open(tmp_path / "run")


def test_a_database_that_is_cut_off_is_one_line(tmp_path):
    path = write(tmp_path / "run", StoragePlugin.SQLITE3, CompressionMode.NONE, count=1000)
    [file] = path.glob("*.db3")
    content = file.read_bytes()
    for size in range(0, len(content), 997):
        file.write_bytes(content[:size])
        with pytest.raises(BagFormatError) as caught:
            read_all(path)
        assert "\n" not in str(caught.value)
