"""One SQLite file of rosbag2: its topics and messages. Times are integer nanoseconds."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from urllib.parse import quote

import apsw
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

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
from rpud_sim.bag.metadata import Topic, TopicSummary, profiles_from_yaml
from rpud_sim.bag.records import CONTENT_LIMIT, reading

_LEAST_PART = 1000  # messages that are read together; more in a bag of more than _MOST_PARTS of it
_MOST_PARTS = 256  # each is a query, which may read the whole table


class SqliteFile:
    """Open SQLite file of rosbag2, with the members of ``McapFile`` that a reader needs.

    It has no metadata records. The log time of a message is also its publish time.
    """

    compressions = frozenset[str]()
    closed = True

    def __init__(self, path: Path, shown: Path) -> None:
        self._shown = shown
        with reading(shown):
            self.size = path.stat().st_size
            # The library makes a URI of the path.
            quoted = Path(quote(os.path.abspath(path)))
            self._reader = Sqlite3Reader(quoted)
        with self._reading():
            _check_tables(quoted, self.size)
            self._reader.open()
        try:
            with self._reading():
                self._read_topics()
        except BaseException:
            self._reader.close()
            raise

    def __enter__(self) -> SqliteFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.close()

    @property
    def message_count(self) -> int:
        return sum(count for count, _, _ in self._spans.values())

    @property
    def start_time(self) -> int:
        """Time of the first message [ns]; 0 without messages."""
        return min((first for count, first, _ in self._spans.values() if count), default=0)

    @property
    def end_time(self) -> int:
        """Time of the last message [ns]; 0 without messages."""
        return max((last for count, _, last in self._spans.values() if count), default=0)

    def records(self, name: str) -> Iterator[dict[str, str]]:
        """Yield nothing: SQLite files have no metadata records."""
        return iter(())

    def topic(self, name: str) -> TopicSummary:
        """Return the summary of one topic."""
        connections = self.topic_channels[name]
        spans = [self._spans[each.id] for each in connections if each.id in self._spans]
        first = connections[0]
        assert isinstance(first.ext, ConnectionExtRosbag2)
        return TopicSummary(
            topic=Topic(
                name=name,
                type=first.msgtype,
                type_hash=first.digest or "",
                offered_qos=profiles_from_yaml(dump_qos_v9(first.ext.offered_qos_profiles)),
                serialization_format=first.ext.serialization_format,
            ),
            message_count=sum(count for count, _, _ in spans),
            first_time=min((each for _, each, _ in spans), default=None),
            last_time=max((each for _, _, each in spans), default=None),
            definition=self._definition(first),
            kinds=frozenset(
                (each.ext.serialization_format, each.msgtype, "")
                for each in connections
                if isinstance(each.ext, ConnectionExtRosbag2)
            ),
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
            yield BagSegment(start, end - 1, size, names, partial(self._blocks, start, end))

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
        self, start: int, end: int, topics: Collection[str] | None
    ) -> Iterator[MessageBlock]:
        return blocks_of(self._messages(start, end if end <= LATEST else None, topics))

    def _messages(
        self, start: int, end: int | None, topics: Collection[str] | None
    ) -> Iterator[Message]:
        wanted = [
            connection
            for name, connections in self.topic_channels.items()
            for connection in connections
            if topics is None or name in topics
        ]
        if not wanted:
            return
        with self._reading():
            for connection, time, data in self._reader.messages(wanted, start, end):
                yield Message(connection.topic, time, time, data)

    @property
    def _database(self) -> apsw.Connection:
        if self._reader.dbconn is None:
            raise BagError(f"{self._shown} was closed; open the bag again")
        return self._reader.dbconn

    def _read_topics(self) -> None:
        database = self._database
        database.limit(apsw.SQLITE_LIMIT_LENGTH, CONTENT_LIMIT)
        self.topic_channels: dict[str, list[Connection]] = {}
        for each in self._reader.connections:
            assert isinstance(each.ext, ConnectionExtRosbag2)
            texts = (each.topic, each.msgtype, each.ext.serialization_format)
            if not all(isinstance(text, str) for text in texts):
                raise BagFormatError("a topic has no name, type or format")
            self.topic_channels.setdefault(each.topic, []).append(each)
        known = {each.id for each in self._reader.connections}
        self._spans: dict[int, tuple[int, int, int]] = {}
        for time, kind in database.execute(
            "SELECT timestamp, typeof(data) FROM messages WHERE typeof(timestamp) <> 'integer'"
            " OR timestamp < 0 OR typeof(data) <> 'blob' LIMIT 1"
        ):
            raise BagFormatError(
                f"a message has the time {time!r:.80} and {kind} data; times are integers from 0 "
                f"to {LATEST}, and data is a blob"
            )
        for topic, count, first, last in database.execute(
            "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp)"
            " FROM messages GROUP BY topic_id"
        ):
            if topic in known:
                self._spans[topic] = (count, first, last)

    def _definition(self, connection: Connection) -> str | None:
        """Return the definition in the file, or the installed one: before Iron files had none."""
        if connection.msgdef.format == MessageDefinitionFormat.MSG:
            return str(connection.msgdef.data)
        if connection.msgdef.format == MessageDefinitionFormat.NONE:
            try:
                return find_definition(connection.msgtype)
            except DefinitionNotFoundError:
                return None
        return None

    @contextmanager
    def _reading(self) -> Iterator[None]:
        with reading(self._shown):
            try:
                yield
            except (apsw.Error, AttributeError, ReaderError) as error:
                raise BagFormatError(f"it is damaged: {' '.join(str(error).split())}") from error


def _check_tables(path: Path, size: int) -> None:
    """Refuse tables of more content than the file: a few bytes could make any size of it."""
    place = f"file:{path}?immutable=1"
    flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
    with closing(apsw.Connection(place, flags=flags)) as database:
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
