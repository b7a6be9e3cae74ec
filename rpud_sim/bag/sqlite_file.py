"""One SQLite file of rosbag2: its topics and messages. Times are integer nanoseconds."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import apsw

from rpud_sim.bag.definitions import find_definition
from rpud_sim.bag.errors import BagError, BagFormatError, DefinitionNotFoundError
from rpud_sim.bag.messages import (
    LATEST,
    OVERLAP_LIMIT,
    BagSegment,
    Message,
    MessageBlock,
    blocks_of,
)
from rpud_sim.bag.metadata import Topic, TopicSummary, load_offered_qos
from rpud_sim.bag.records import CONTENT_LIMIT, reading

_LEAST_PART = 1000  # messages that are read together; more in a bag of more than _MOST_PARTS of it
_MOST_PARTS = 256  # each is a query, which may read the whole table
# Columns of a topic; files before Iron lack some of the last ones.
_COLUMNS = ("name", "type", "serialization_format", "offered_qos_profiles", "type_description_hash")


class _RecordedTopic(NamedTuple):
    number: int
    name: str
    type: str
    serialization_format: str
    offered_qos: str
    type_hash: str


class SqliteFile:
    """Open SQLite file of rosbag2, with the members of ``McapFile`` that a reader needs.

    It has no metadata records. The log time of a message is also its publish time.
    """

    compressions = frozenset[str]()
    closed = True

    def __init__(self, path: Path, shown: Path) -> None:
        self._shown = shown
        self._open = True
        flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
        with self._reading():
            self.size = path.stat().st_size
            place = f"file:{quote(os.path.abspath(path))}?immutable=1"
            self._database = apsw.Connection(place, flags=flags)
        try:
            with self._reading():
                _check_tables(self._database, self.size)
                self._database.limit(apsw.SQLITE_LIMIT_LENGTH, CONTENT_LIMIT)
                self._read_topics()
                self._read_spans()
        except BaseException:
            self._database.close()
            raise

    def __enter__(self) -> SqliteFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._open = False
        self._database.close()

    def records(self, name: str) -> Iterator[dict[str, str]]:
        """Yield nothing: SQLite files have no metadata records."""
        return iter(())

    def topic(self, name: str) -> TopicSummary:
        """Return the summary of one topic."""
        channels = self.topic_channels[name]
        spans = [self._spans[each.number] for each in channels if each.number in self._spans]
        first = channels[0]
        with self._reading():
            offers = load_offered_qos(first.offered_qos)
        return TopicSummary(
            topic=Topic(name, first.type, first.type_hash, offers, first.serialization_format),
            message_count=sum(count for count, _, _ in spans),
            first_time=min((each for _, each, _ in spans), default=None),
            last_time=max((each for _, _, each in spans), default=None),
            definition=self._definition(first.type),
            kinds=frozenset((each.serialization_format, each.type, "") for each in channels),
        )

    def segments(self) -> Iterator[BagSegment]:
        """Yield parts of about equal numbers of messages."""
        parts = min(_MOST_PARTS, -(-self.message_count // _LEAST_PART)) or 1
        size = self.size // parts
        edges = self._edges(-(-self.message_count // parts))
        for start, end in pairwise(sorted({*edges})):
            if size * edges.count(start) > OVERLAP_LIMIT:
                raise BagFormatError(f"{self._shown}: too many messages have the time {start}")
            names = frozenset(self.topic_channels)
            yield BagSegment(start, end - 1, size, names, partial(self._blocks, start, end - 1))

    def _edges(self, step: int) -> list[int]:
        """Return the times of the first message and each ``step`` later, and the end [ns]."""
        if not self.message_count:
            return []
        with self._reading():
            rows = self._database.execute(
                "SELECT timestamp FROM (SELECT timestamp, ROW_NUMBER() OVER (ORDER BY timestamp)"
                f" AS number FROM messages) WHERE number % {step} = {1 % step}"
            )
            return [*(time for (time,) in rows), self.end_time + 1]

    def _blocks(
        self, first: int, last: int, topics: Collection[str] | None
    ) -> Iterator[MessageBlock]:
        return blocks_of(self._messages(first, last, topics))

    def _messages(self, first: int, last: int, topics: Collection[str] | None) -> Iterator[Message]:
        names = {
            channel.number: name
            for name, channels in self.topic_channels.items()
            for channel in channels
            if topics is None or name in topics
        }
        with self._reading():
            for number, time, data in self._database.execute(
                "SELECT topic_id, timestamp, data FROM messages WHERE timestamp BETWEEN ? AND ?"
                f" AND topic_id IN ({','.join('?' * len(names))}) ORDER BY timestamp",
                (first, last, *names),
            ):
                yield Message(names[number], time, time, data)

    def _read_topics(self) -> None:
        held = {name for _, name, *_ in self._database.execute("PRAGMA table_info(topics)")}
        columns = [f"COALESCE({each}, '')" if each in held else "''" for each in _COLUMNS]
        self.topic_channels: dict[str, list[_RecordedTopic]] = {}
        query = f"SELECT id, {', '.join(columns)} FROM topics ORDER BY id"
        for channel in map(_RecordedTopic._make, self._database.execute(query)):
            if not all(isinstance(text, str) for text in channel[1:]):
                raise BagFormatError("a topic has a name, type or format that is no text")
            self.topic_channels.setdefault(channel.name, []).append(channel)
        # Before Iron files had no definitions.
        tables = "SELECT 1 FROM pragma_table_info('message_definitions')"
        self._definitions: dict[str, str | None] = {}
        if self._database.execute(tables).fetchone():
            self._definitions |= self._database.execute(
                "SELECT topic_type, CASE encoding WHEN 'ros2msg' THEN"
                " CAST(encoded_message_definition AS TEXT) END"
                " FROM message_definitions ORDER BY id DESC"
            )

    def _read_spans(self) -> None:
        """Read count, first and last time of the messages of each topic."""
        for time, kind in self._database.execute(
            "SELECT timestamp, typeof(data) FROM messages WHERE typeof(timestamp) <> 'integer'"
            " OR timestamp < 0 OR typeof(data) <> 'blob' LIMIT 1"
        ):
            raise BagFormatError(
                f"a message has the time {time!r:.80} and {kind} data; times are integers from 0 "
                f"to {LATEST}, and data is a blob"
            )
        known = {each.number for channels in self.topic_channels.values() for each in channels}
        self._spans: dict[int, tuple[int, int, int]] = {
            topic: (count, first, last)
            for topic, count, first, last in self._database.execute(
                "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp)"
                " FROM messages GROUP BY topic_id"
            )
            if topic in known
        }
        spans = self._spans.values()
        self.message_count = sum(count for count, _, _ in spans)
        self.start_time = min((first for _, first, _ in spans), default=0)
        self.end_time = max((last for _, _, last in spans), default=0)

    def _definition(self, type_name: str) -> str | None:
        if type_name in self._definitions:
            return self._definitions[type_name]
        try:
            return find_definition(type_name)
        except DefinitionNotFoundError:
            return None

    @contextmanager
    def _reading(self) -> Iterator[None]:
        if not self._open:
            raise BagError(f"{self._shown} was closed; open the bag again")
        with reading(self._shown):
            try:
                yield
            except apsw.Error as error:
                raise BagFormatError(f"it is damaged: {' '.join(str(error).split())}") from error


def _check_tables(database: apsw.Connection, size: int) -> None:
    """Refuse tables of more content than the file: a few bytes could make any size of it."""
    strange = database.execute(
        "SELECT t.name FROM pragma_table_list AS t LEFT JOIN pragma_table_xinfo(t.name) AS c"
        " WHERE lower(t.name) IN ('schema', 'topics', 'messages', 'message_definitions')"
        " AND (t.type <> 'table' OR c.hidden OR c.dflt_value IS NOT NULL)"
    ).fetchone()
    if strange:
        raise BagFormatError(f"its table {strange[0]:.80} has content that is not stored in it")
    # Rows have the lengths of their content, which is not read for it, and which several rows
    # of a damaged file may share.
    sums = database.execute(
        'SELECT t.name, printf(\'SELECT TOTAL(octet_length("%w")) FROM "%w"\', c.name, t.name)'
        " FROM pragma_table_list AS t JOIN pragma_table_xinfo(t.name) AS c WHERE"
        " lower(t.name) IN ('topics', 'message_definitions') OR"
        " lower(t.name) = 'messages' AND lower(c.name) = 'data'"
    ).fetchall()
    for name, query in sums:
        [(total,)] = database.execute(str(query))
        if total > size:
            raise BagFormatError(f"its {name} have more than the file's {size} bytes")
    # Each message would be read once for each topic with its number.
    for number, count in database.execute(
        "SELECT id, COUNT(*) FROM topics GROUP BY id HAVING COUNT(*) > 1 LIMIT 1"
    ):
        raise BagFormatError(f"{count} topics have the number {number!r:.80}")
