"""Record: the messages on which expectations are evaluated, from a bag or live."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

import numpy as np

from rpud_sim.bag import Column
from rpud_sim.bag import open as open_bag
from rpud_sim.foundation.options import NAMESPACE
from rpud_sim.foundation.quantities import ParameterError, did_you_mean
from rpud_sim.messages.batch import Batch
from rpud_sim.recorded.drill_tables import drill_table
from rpud_sim.recorded.runs import RecordedRun, choose_namespace, drill_namespaces, runs_of
from rpud_sim.verdicts.formulas import Signal, SignalFormula
from rpud_sim.verdicts.messages import MissingMessages, TopicBatch, TopicMessages
from rpud_sim.verdicts.names import (
    PERIODIC,
    PERIODIC_HOLD,
    TYPES,
    Expectation,
    SignalField,
    check_use,
    drill_columns,
    find_field,
)


class Record:
    """Messages of some topics, from which expectations take their signals.

    Of a bag only the last run counts. Live messages are of one run: a reset needs another record.
    Topics have names relative to ``namespace``, or absolute names.
    """

    def __init__(self, namespace: str = NAMESPACE) -> None:
        self._namespace = namespace.rstrip("/")
        self._batches: dict[str, list[TopicBatch]] = {}
        self._live: dict[str, list[tuple[int, int, Any]]] = {}  # stamp, number, message
        self._columns: dict[str, tuple[Column, ...]] = {}
        self._losses: dict[str, int] = {}
        self._notes: dict[str, str] = {}
        self._count = 0
        self._kept: dict[str, TopicMessages] = {}
        self.runs = 0  # number of runs in the bag; 0 if it has no journal. The last one counts

    @classmethod
    def from_bag(
        cls,
        path: str | os.PathLike[str],
        topics: Collection[str],
        namespace: str | None = None,
        progress: Callable[[int], object] = lambda count: None,
        expectations: Iterable[Expectation] = (),
    ) -> Record:
        """Read topics of a bag; without ``namespace`` the only drill counts.

        ``progress`` is called with the number of messages since its last call. The fields that
        ``expectations`` name are checked first. A RecordingError explains a failure.
        """
        with open_bag(path) as bag:
            if spaces := drill_namespaces(bag):
                namespace = choose_namespace(path, spaces, namespace)
            record = cls(NAMESPACE if namespace is None else namespace)
            known = {summary.topic.name: summary for summary in bag.topics}
            wanted: dict[str, str] = {}  # topics by their names in the bag
            for topic in topics:
                if (name := record._absolute(topic)) not in known:
                    hint = did_you_mean(name, known, others=False)
                    record._notes[topic] = f"the bag holds no topic {name}{hint}"
                    continue
                wanted[name] = topic
                record._columns[topic] = bag.columns(name)
                losses = known[name].losses
                record._losses[topic] = (losses.total or 0) if losses is not None else 0
            for expectation in expectations:
                record._check(expectation)

            def leave_out(name: str, reason: str) -> None:
                record._losses[wanted[name]] += 1

            journal = record._absolute("journal")
            last: RecordedRun | None = None
            if journal in known and known[journal].message_count:
                last = runs_of(bag, journal)[-1]
                record.runs = last.runs
            for batch in bag.tables(list(wanted), leave_out=leave_out) if wanted else ():
                held = last.holds(batch.columns["publish_time"]) if last else slice(None)
                columns = {name: values[held] for name, values in batch.columns.items()}
                record._add_columns(wanted[batch.topic], columns)
                progress(batch.message_count)
        return record

    def add(self, topic: str, stamp: int, message: Any) -> None:
        """Add a message as it arrives: a mapping, or an object with fields that stay as they are.

        The stamp is from its header, or else its arrival [ns].
        """
        topic = self._relative(topic)
        self._live.setdefault(topic, []).append((int(stamp), self._count, message))
        self._count += 1
        self._kept.clear()

    def add_batch(self, batch: Batch) -> None:
        """Add messages of a topic of the drill, as columns or as bytes."""
        topic = self._relative(batch.topic)
        table = drill_table(TYPES[topic])
        self._columns[topic] = table.columns
        self._add_columns(topic, table.batch(batch).columns)
        self._kept.clear()

    def add_losses(self, topic: str, count: int) -> None:
        """Count messages that were lost on their way, at times that are not known."""
        topic = self._relative(topic)
        self._losses[topic] = self._losses.get(topic, 0) + count
        self._kept.clear()

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics with messages, in the order of their names."""
        return tuple(sorted({*self._batches, *self._live}))

    def note(self, topic: str) -> str:
        """Return why a topic has no messages; empty if it has some, or if it is not known."""
        if topic in self.topics:
            return "" if len(self.messages(topic)) else f"{topic} has no message in the last run"
        return self._notes.get(topic, f"{topic} has no message")

    def lost(self, topic: str) -> int:
        """Return how many messages are lost at unknown times, which their numbers do not show."""
        return max(0, self._losses.get(topic, 0) - self.messages(topic).missing.total)

    def missing(self, topic: str) -> MissingMessages:
        """Return the missing messages of a topic: those at known times, and ``lost``."""
        return self.messages(topic).missing._replace(anywhere=self.lost(topic))

    def span(self, topics: Collection[str]) -> tuple[int, int] | None:
        """Return the first and last nanosecond that a record of some topics covers.

        It begins with the run, or with the first periodic message if that comes much later, or
        else with the first of all. It ends with the last one. Commands and topics of others count
        only if there are no others; without messages it is None.
        """
        filled = [topic for topic in sorted(topics) if len(self.messages(topic))]
        own = [each for each in filled if each in TYPES and not each.startswith("command/")]
        counting = own or filled
        if not counting:
            return None
        periodic = [topic for topic in counting if topic in PERIODIC] or counting
        begin = min(int(self.messages(topic).stamps[0]) for topic in periodic)
        start = self._start
        if start is not None and start <= begin <= start + PERIODIC_HOLD:
            begin = start
        return begin, max(int(self.messages(topic).stamps[-1]) for topic in counting)

    def zero(self, topics: Collection[str]) -> int:
        """Return the stamp from which a verdict's times count [ns]: simulation time zero."""
        if (start := self._start) is not None:
            return start
        span = self.span(topics)
        return span[0] if span else 0

    def field(self, signal: Signal) -> SignalField | None:
        """Return the field of a signal; None if its type is not known."""
        topic = signal.topic
        columns = self._columns.get(topic) or (drill_columns(topic) if topic in TYPES else None)
        return None if columns is None else find_field(signal, columns)

    def messages(self, topic: str) -> TopicMessages:
        """Return the messages of a topic in the last run."""
        if topic not in self._kept:
            batches = list(self._batches.get(topic, ()))
            if topic in self._live:
                stamps, published, messages = zip(*self._live[topic], strict=True)
                times = np.array(stamps, np.int64), np.array(published, np.int64)
                batches.append(TopicBatch(*times, messages=messages))
            self._kept[topic] = TopicMessages(topic, batches)
        return self._kept[topic]

    def _check(self, expectation: Expectation) -> None:
        for part in expectation.formula.walk():
            if isinstance(part, SignalFormula):
                try:
                    check_use(part, self.field(part.signal))
                except ParameterError as error:
                    raise ParameterError(f"{expectation.name}: {error}") from None

    @property
    def _start(self) -> int | None:
        """Stamp of the run's beginning, simulation time zero [ns]; None without a journal."""
        journal = self.messages("journal")
        kinds = journal.column("kind") if len(journal) else []
        begun = zip(kinds, journal.stamps.tolist(), strict=False)
        return next((stamp for kind, stamp in begun if kind == "begin"), None)

    def _add_columns(self, topic: str, columns: Mapping[str, np.ndarray]) -> None:
        if self._columns[topic] and self._columns[topic][0].name == "time":
            stamps = columns["time"]
        elif "header.stamp" in columns:
            stamps = columns["header.stamp"]
            if topic.startswith("command/"):  # a stamp of zero is not a stamp
                stamps = np.where(stamps == 0, columns["log_time"], stamps)
        else:
            stamps = columns["log_time"]
        batch = TopicBatch(stamps, columns["publish_time"], columns)
        self._batches.setdefault(topic, []).append(batch)

    def _relative(self, topic: str) -> str:
        """Return the name that expectations have for a topic: relative for the drill's own."""
        relative = topic.removeprefix(f"{self._namespace}/")
        return relative if relative in TYPES else topic

    def _absolute(self, topic: str) -> str:
        return topic if topic.startswith("/") else f"{self._namespace}/{topic}"
