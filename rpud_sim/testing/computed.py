"""What the drill of a test publishes, computed in this process from the drill's journal."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from rclpy.serialization import deserialize_message
from rpud_msgs.msg import JournalEntry as EntryMessage
from rpud_msgs.msg import Status

from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Batch
from rpud_sim.messages.definitions import installed_codec
from rpud_sim.recorded.growing_run import GrowingRun
from rpud_sim.recorded.streams import stamps_of
from rpud_sim.ros.graph import message_class
from rpud_sim.simulation.changes import Change, action_of
from rpud_sim.simulation.fields import CommandCounts
from rpud_sim.simulation.plan import JournalEntry, Plan, StrataTexts
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.topics import PROVED, TOPICS, offered_topics
from rpud_sim.testing.collector import StoredTopic
from rpud_sim.testing.errors import DrillError, LostMessagesError

_PADDING = 3  # that the middleware may add to a message [bytes]
# Fields of a status that the journal does not determine.
_OWN = {*vars(CommandCounts()), "commands_lost", "state", "journal_entries"}


class ComputedTopic:
    """Messages of a topic of the drill in order, computed when they are asked for.

    ``compute`` gives the messages so far.
    """

    lost = 0  # messages
    stamped = True  # whether the messages have stamps

    def __init__(self, name: str, topic: str, compute: Callable[[], list[Batch]]) -> None:
        self.name = name  # absolute
        self.kind = message_class(TOPICS[topic].type)  # class of the messages
        self.latched = TOPICS[topic].latched  # whether a late subscriber gets the last ones
        self._compute = compute
        self._codec = installed_codec(TOPICS[topic].type)
        self._serialized: list[Batch] = []  # the first ones
        self._messages: list[Any] = []  # the first ones

    def __len__(self) -> int:
        return sum(map(len, self.batches))

    @property
    def batches(self) -> list[Batch]:
        """Messages as they were computed, columns."""
        return self._compute()

    @property
    def stamps(self) -> list[int]:
        """Stamp of each message [ns]."""
        return [stamp for batch in self._as_bytes() for stamp in stamps_of(batch).tolist()]

    @property
    def payloads(self) -> list[bytes]:
        """Serialized messages."""
        return [each.message(number) for each in self._as_bytes() for number in range(len(each))]

    def messages(self) -> list[Any]:
        known = len(self._messages)
        for batch in self._as_bytes():
            for number in range(min(known, len(batch)), len(batch)):
                self._messages.append(deserialize_message(batch.message(number), self.kind))
            known = max(0, known - len(batch))
        return list(self._messages)

    def latest(self) -> Any:
        """Return the latest message, None without one."""
        batches = self._as_bytes()
        if not batches:
            return None
        return deserialize_message(batches[-1].message(len(batches[-1]) - 1), self.kind)

    def _as_bytes(self) -> list[Batch]:
        for batch in self.batches[len(self._serialized) :]:
            self._serialized.append(batch.serialized(self._codec))
        return self._serialized


class ComputedDrill:
    """Run of the drill since its latest reset, as far as its journal and its time are known.

    ``refresh`` gives the entries of the journal that are not known yet.
    """

    def __init__(
        self,
        resolve: Callable[[str], str],
        refresh: Callable[[], Iterable[EntryMessage]],
    ) -> None:
        self.count = 0  # entries of the journal that are known, since the drill's start
        self.topics: Mapping[str, ComputedTopic] = {}  # by absolute name
        self.rate = 0  # of the telemetry [Hz]
        self._resolve = resolve
        self._refresh = refresh
        self._entries: list[JournalEntry] = []
        self._journal: list[Batch] = []  # messages of the entries
        self.beginning = b""  # first of them, which contains the strata even if it refers to them
        self._strata = StrataTexts()
        self._origin = 0  # stamp of simulation time zero [ns]
        self._time = 0  # simulation time that the drill has reached [ns]
        self._status: Status | None = None  # at this time, to be compared
        self._run: GrowingRun | None = None
        self._scheduled = 0  # entries that the run has
        self._batches: dict[str, list[Batch]] = {}  # by topic
        self._asked: set[str] = set()  # topics, in this run or one before: tests ask for the same

    @property
    def entries(self) -> tuple[JournalEntry, ...]:
        """Entries of the journal since the latest reset."""
        self.refresh()
        return tuple(self._entries)

    def add(self, entries: Iterable[EntryMessage]) -> None:
        """Add the next entries of the journal; one that begins a run forgets all before."""
        for entry in entries:
            if entry.sequence != self.count:
                continue  # it is known already
            self.count += 1
            content = json.loads(entry.content)
            if entry.kind == "begin":
                content = dict(self._strata.complete(entry.sequence, content))
                self._begin(content["parameters"])
            elif entry.kind == "origin":
                self._origin = int(content["origin"])
            time = int(content.pop("time"))
            self._entries.append(JournalEntry(int(entry.sequence), time, entry.kind, content))
            self._journal.append(_message(entry, time, entry.content))
            if entry.kind == "begin":
                self.beginning = _message(entry, time, self._entries[-1].text).message(0)

    def restart(self) -> None:
        """Begin with another journal, of a node that has been configured again."""
        self.count = 0
        self._strata = StrataTexts()

    def refresh(self) -> None:
        """Take what is new in the journal."""
        self.add(self._refresh())

    def reach(self, stamp: int, status: Status) -> None:
        """Set the stamp that the drill has reached [ns], and the status that it had there.

        The status shows whether the drill computes the same bits as this process.
        """
        self._time, self._status = stamp - self._origin, status

    def _begin(self, parameters: Mapping[str, Any]) -> None:
        self._entries.clear()
        self._journal.clear()
        self._batches.clear()
        self._time, self._status, self._run, self._scheduled = 0, None, None, 0
        self.rate = int(parameters["telemetry_rate"])
        names = {name for name in offered_topics(parameters) if name in PROVED} | {"journal"}
        self.topics = {
            self._resolve(name): ComputedTopic(
                self._resolve(name), name, partial(self._compute, name)
            )
            for name in sorted(names)
        }

    def _compute(self, topic: str) -> list[Batch]:
        """Return the messages of a topic up to the current time."""
        self.refresh()
        if topic == "journal":
            return self._journal
        self._asked.add(topic)
        found = self._batches.setdefault(topic, [])
        if self._entries:
            found += self._advanced().new(topic)
        return found

    def _advanced(self) -> GrowingRun:
        """Return the run at the current time, with all changes."""
        if self._run is None:
            self._run = GrowingRun(Plan.of(self._entries[:1]), self._asked)
            self._scheduled = 1
        if self._status is not None:
            self._carry_out(self._run, int(self._status.journal_entries) - self.count)
            self._compare(self._run.run, self._status)
            self._status = None
        self._carry_out(self._run, 0)
        return self._run

    def _carry_out(self, run: GrowingRun, later: int) -> None:
        """Advance with all entries but the last ones, whose number is given as less than zero."""
        end = len(self._entries) + later
        new = self._entries[self._scheduled : end]
        self._scheduled = max(self._scheduled, end)
        run.advance([Change(e.time, action_of(e.kind, e.content)) for e in new], self._time)

    def _compare(self, run: Run, status: Status) -> None:
        """Raise a DrillError if the drill's status differs from the computed run's."""
        for name, value in run.status().fields.items():
            theirs = getattr(status, name, None)
            if name in _OWN or isinstance(value, dict):
                continue
            if theirs != value and not (theirs != theirs and value != value):  # NaN is equal, too
                raise DrillError(
                    f"the drill computes other values than this process: {name} is {theirs!r} "
                    f"there and {value!r} here, at {run.time / SECOND:.9g} s of simulation time; "
                    "the versions or the compiled kernels of the two differ"
                )


def _message(entry: EntryMessage, time: int, content: str) -> Batch:
    """Return the message of an entry with some content, at a simulation time [ns]."""
    stamp = {"sec": entry.header.stamp.sec, "nanosec": entry.header.stamp.nanosec}
    header = {"stamp": stamp, "frame_id": entry.header.frame_id}
    named = {"sequence": entry.sequence, "kind": entry.kind, "content": content}
    batch = Batch.of(time, "journal", {"header": header, **named})
    return batch.serialized(installed_codec(TOPICS["journal"].type))


def check_equal(computed: ComputedTopic, heard: StoredTopic) -> None:
    """Raise an error if what was received of a topic is not, bit for bit, what is computed."""
    if heard.lost:
        raise LostMessagesError(f"{heard.lost} messages of {heard.name} are lost")
    wire = heard.payloads
    count = min(len(wire), len(computed))  # a latched topic has older ones
    own = computed.payloads[len(computed) - count :]
    first = len(wire) - count
    for ours, theirs, stamp in zip(own, wire[first:], heard.stamps[first:], strict=True):
        if theirs[: len(ours)] != ours or len(theirs) - len(ours) > _PADDING:
            raise DrillError(
                f"a message of {computed.name} at {stamp / SECOND:.9g} s is another one than this "
                "process computes: the versions or the compiled kernels of the two differ"
            )
