"""Record: the signals on which expectations are evaluated, from a bag or live."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Collection, Iterable
from typing import Any

import numpy as np

from rpud_sim.bag import Batch, Column, Kind, TopicSummary
from rpud_sim.bag import open as open_bag
from rpud_sim.bag.columns import RECEIVED, Sequences, objects, to_rows
from rpud_sim.foundation.quantities import suggestion
from rpud_sim.verdicts.messages import Live, Piece, Table, TopicMessages, get, time_of
from rpud_sim.verdicts.missing import Missing
from rpud_sim.verdicts.names import (
    DIAGNOSTICS,
    PERIODIC,
    PERIODIC_HOLD,
    TYPES,
    Field,
    block_columns,
    drill_columns,
    find_field,
)
from rpud_sim.verdicts.runs import Entry, LastRun, entry_time, last_run
from rpud_sim.verdicts.units import ExpectationError
from rpud_sim.verdicts.vocabulary import Signal

NAMESPACE = "/rpud"
_STATUS_TYPE = "rpud_msgs/msg/Status"


class Record:
    """Messages of some topics, from which expectations take their signals.

    Only the last run counts: a reset of the drill begins a new one, as the journal shows. Topics
    may be added by names relative to ``namespace``, or absolute names.
    """

    def __init__(self, namespace: str = NAMESPACE) -> None:
        self._namespace = namespace.rstrip("/")
        self._pieces: dict[str, list[Piece]] = {}
        self._live: dict[str, tuple[Live, list[int], list[int]]] = {}
        self._columns: dict[str, tuple[Column, ...]] = {}
        self._losses: dict[str, int] = {}
        self._notes: dict[str, str] = {}
        self._count = 0
        self._run: LastRun | None = None
        self._kept: dict[str, TopicMessages] = {}

    @classmethod
    def from_bag(
        cls,
        path: str | os.PathLike[str],
        topics: Collection[str],
        namespace: str | None = None,
        progress: Callable[[int], object] = lambda count: None,
    ) -> Record:
        """Read topics of a bag, by names relative to the drill's namespace or absolute names.

        Without ``namespace`` it is that of the only status in the bag. ``progress`` is called with
        the number of messages since its last call.
        """
        with open_bag(path) as bag:
            known = {summary.topic.name: summary for summary in bag.topics}
            record = cls(bag_namespace(bag.topics, namespace))
            wanted = {record._absolute(topic): topic for topic in topics}
            for name, topic in wanted.items():
                if name not in known:
                    hint = suggestion(name, known)
                    record._notes[topic] = f"the bag holds no topic {name}{hint}"
            wanted = {name: topic for name, topic in wanted.items() if name in known}
            for name, topic in wanted.items():
                record._columns[topic] = bag.columns(name)
                losses = known[name].losses
                record._losses[topic] = (losses.total or 0) if losses is not None else 0
            damaged: dict[str, int] = {}

            def leave_out(name: str, reason: str) -> None:
                damaged[name] = damaged.get(name, 0) + 1

            for batch in bag.batches(list(wanted), leave_out=leave_out) if wanted else ():
                record._add_batch(wanted[batch.topic], batch)
                progress(batch.message_count)
            for name, count in damaged.items():
                record._losses[wanted[name]] += count
        return record

    def add(self, topic: str, stamp: int, message: Any) -> None:
        """Add a message as it arrives, with the stamp of its header, or else of its arrival [ns].

        The message is a mapping, or an object with its fields as attributes. It must not change
        from now on.
        """
        topic = self._relative(topic)
        if topic in ("waveform", "trajectory"):
            self._add_block(topic, message)
        else:
            if topic not in self._live:
                self._live[topic] = Live(), [], []
            live, stamps, published = self._live[topic]
            live.messages.append(message)
            stamps.append(int(stamp))
            published.append(self._count)
        self._count += 1
        self._forget()

    def add_losses(self, topic: str, count: int) -> None:
        """Count messages that were lost on their way, at times that are not known."""
        topic = self._relative(topic)
        self._losses[topic] = self._losses.get(topic, 0) + count
        self._forget()

    def clear(self) -> None:
        """Forget all messages, as after a reset of the drill."""
        self._pieces.clear()
        self._live.clear()
        self._losses.clear()
        self._forget()

    @property
    def runs(self) -> int:
        """Number of runs in the recording; 0 if there is no journal. The last one counts."""
        return self._last_run.runs

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics with messages, in the order of their names."""
        return tuple(sorted({*self._pieces, *self._live}))

    def note(self, topic: str) -> str:
        """Return why a topic has no messages; empty if it has some, or if it is not known."""
        if topic in self.topics:
            return "" if len(self.messages(topic)) else f"{topic} has no message in the last run"
        return self._notes.get(topic, f"{topic} has no message")

    def lost(self, topic: str) -> int:
        """Return the number of messages lost at unknown times.

        Of losses that the recorder counted, those are left out whose place the messages' own
        numbers show.
        """
        counted = self._losses.get(topic, 0)
        return max(0, counted - self.messages(topic).missing.total)

    def missing(self, topic: str) -> Missing:
        return dataclasses.replace(self.messages(topic).missing, anywhere=self.lost(topic))

    def span(self, topics: Collection[str]) -> tuple[int, int] | None:
        """Return the first and last nanosecond that a record of some topics covers.

        It begins with the run, or with the first message of a periodic topic if that comes too late
        for the first of the run; without a periodic topic, with the first message of any. It ends
        with the last message of any. Commands and topics of others do not count, unless there are
        no others. Without messages there is none.
        """
        filled = [topic for topic in sorted(topics) if len(self.messages(topic))]
        own = [each for each in filled if each in TYPES and not each.startswith("command/")]
        counting = own or filled
        if not counting:
            return None
        periodic = [topic for topic in counting if topic in PERIODIC] or counting
        begin = min(int(self.messages(topic).stamps[0]) for topic in periodic)
        run = self._last_run
        if run.origin is not None and run.stamp <= begin <= run.stamp + PERIODIC_HOLD:
            begin = run.stamp
        return begin, max(int(self.messages(topic).stamps[-1]) for topic in counting)

    def zero(self, topics: Collection[str]) -> int:
        """Return the stamp from which a verdict's times count [ns]: simulation time zero."""
        if self._last_run.origin is not None:
            return self._last_run.origin
        span = self.span(topics)
        return span[0] if span else 0

    def field(self, signal: Signal) -> Field | str | None:
        """Return the field of a signal; None if its type is not known."""
        if signal.topic == DIAGNOSTICS:
            return signal.field
        if signal.topic in TYPES:
            return find_field(signal.field, self._columns_of(signal.topic), signal.topic)
        if signal.topic in self._columns:
            return find_field(signal.field, self._columns[signal.topic], signal.topic)
        return None

    def messages(self, topic: str) -> TopicMessages:
        if topic not in self._kept:
            pieces = self._all(topic)
            keep = [self._last_run.holds(each.stamps, each.published) for each in pieces]
            self._kept[topic] = TopicMessages(topic, pieces, keep)
        return self._kept[topic]

    def _columns_of(self, topic: str) -> tuple[Column, ...]:
        return self._columns.get(topic) or drill_columns(topic)

    @property
    def _last_run(self) -> LastRun:
        if self._run is None:
            self._run = last_run([*self._journal()])
        return self._run

    def _journal(self) -> Iterable[Entry]:
        for piece in self._all("journal"):
            columns = [piece.source.values(name, name) for name in ("sequence", "kind", "content")]
            for sequence, kind, content, stamp, published in zip(
                *columns, piece.stamps.tolist(), piece.published.tolist(), strict=True
            ):
                yield Entry(int(sequence), str(kind), stamp, published, entry_time(str(content)))

    def _all(self, topic: str) -> list[Piece]:
        pieces = list(self._pieces.get(topic, ()))
        if topic in self._live:
            live, stamps, published = self._live[topic]
            pieces.append(Piece(live, np.array(stamps, np.int64), np.array(published, np.int64)))
        return pieces

    def _add_batch(self, topic: str, batch: Batch) -> None:
        columns = batch.columns
        if self._columns[topic] and self._columns[topic][0].name == "time":
            stamps = columns["time"]
        elif "header.stamp" in columns:
            stamps = columns["header.stamp"]
            if topic.startswith("command/"):  # a stamp of zero is no stamp
                stamps = np.where(stamps == 0, columns["log_time"], stamps)
        else:
            stamps = columns["log_time"]
        self._pieces.setdefault(topic, []).append(
            Piece(Table(columns), stamps, columns["publish_time"])
        )

    def _add_block(self, topic: str, message: Any) -> None:
        values: dict[str, np.ndarray | Sequences] = {}
        for column in block_columns(topic):
            value = message
            for name in column.name.split("."):
                value = self._count if name in RECEIVED else get(value, name)
            if column.kind is Kind.SEQUENCE:
                values[column.name] = Sequences.of([np.array(value, column.dtype)], column.dtype)
            elif column.kind is Kind.TIME:
                values[column.name] = np.array([time_of(value)], np.int64)
            else:
                values[column.name] = objects([value]).astype(column.dtype)
        rows = to_rows(block_columns(topic), values)
        self._pieces.setdefault(topic, []).append(
            Piece(Table(rows), rows["time"], rows["publish_time"])
        )

    def _relative(self, topic: str) -> str:
        """Return the name that expectations have for a topic: relative for the drill's own."""
        relative = topic.removeprefix(f"{self._namespace}/")
        return relative if relative in TYPES else topic

    def _absolute(self, topic: str) -> str:
        return topic if topic.startswith("/") else f"{self._namespace}/{topic}"

    def _forget(self) -> None:
        self._run = None
        self._kept.clear()


def bag_namespace(topics: Iterable[TopicSummary], namespace: str | None) -> str:
    """Return the namespace of the drill in a bag; by default that of the only status."""
    if namespace is not None:
        return namespace
    found = sorted(
        each.topic.name.rpartition("/")[0] for each in topics if each.topic.type == _STATUS_TYPE
    )
    if len(found) > 1:
        raise ExpectationError(f"the bag holds several drills, {', '.join(found)}: name one")
    return found[0] if found else NAMESPACE
