"""Verification of a bag: its journal is run again and every message compared, in bounded memory."""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import astuple, dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.received_order import open_received
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Batch
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.definitions import find_type_hash, installed_codec
from rpud_sim.model.engine import EngineError
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.journal import (
    UnverifiableError,
    held_journals,
    progress_readers,
    recorded_progress,
    wrong_header,
)
from rpud_sim.recorded.runs import RecordedRun, by_run, runs_of
from rpud_sim.recorded.streams import (
    Head,
    StreamHead,
    TopicStreams,
    difference,
    matched,
    read_together,
)
from rpud_sim.simulation.topics import ALL_COMMAND_TOPICS, COMMAND_TOPICS, PROVED, TOPICS

# Time that is simulated beyond the last stamp: a block may end later [ns].
_TAIL = 2 * SECOND
_TOPIC_DELAY = 1 * SECOND  # longest delay between topics on their way to a recorder [ns]
_MOST_SUSPECTS = 10_000  # kept of a topic: further ones show nothing that these do not
_OF_BEFORE = ("waveform", "trajectory")  # stamped with their first samples
_END = 10 * SECOND  # of a bag, in which a living drill has published a status [ns]
_COUNTERS = ("commands_accepted", "commands_rejected", "commands_discarded")  # of a status


@dataclass(frozen=True)
class MessageDifference:
    """Difference between a recorded message and the computed one."""

    topic: str  # name of its topic
    stamp: int  # its stamp [ns]
    log_time: int  # when it was recorded [ns]
    field: str  # that differs, as in ``wrench.force.z`` or ``position[3]``; empty for the whole
    recorded: str  # value in the bag
    computed: str | None  # value in the simulation; None if the simulation gives no such message


@dataclass(frozen=True)
class Counts:
    """Numbers of messages of a topic, by result of the comparison."""

    equal: int = 0  # bit for bit
    different: int = 0  # in at least one bit
    missing: int = 0  # computed between two recorded ones, and not in the bag
    unexpected: int = 0  # in the bag, and not computed
    head: int = 0  # computed before its first recorded one, when the bag held other topics
    tail: int = 0  # computed after the last recorded one, while the recording continued
    before: int = 0  # in the bag, of before the journal begins: not compared


@dataclass(frozen=True)
class Verification:
    """Result of re-running a bag's journal."""

    topics: dict[str, Counts]  # results of each topic, by its name
    # messages that the recorder counted as lost, by topic; None if it did not count
    lost: dict[str, int | None]
    # by the bag's clock, of a message that its run does not give; None if all agree
    first_difference: MessageDifference | None
    undecided: str  # why it cannot be decided whether messages differ, one line; empty if it can
    simulated: int  # simulation time that was run again [ns]
    # stamp from which on messages are compared [ns]; None if the journal has the drill's start
    begins: int | None
    warnings: tuple[str, ...]  # one line each

    @property
    def proved(self) -> bool:
        """Whether every message is what the simulation gives, and none is missing."""
        return not (self.first_difference or self.undecided or self.lacking)

    @property
    def lacking(self) -> int:
        """Messages that the simulation gives, and that the bag lacks."""
        return self.total.head + self.total.missing + self.total.tail

    @property
    def total(self) -> Counts:
        """Results of all topics together."""
        return Counts(*map(sum, zip(*map(astuple, self.topics.values()), strict=True)))


def verify(
    path: str | os.PathLike[str], report: Callable[[float], object] = lambda seconds: None
) -> Verification:
    """Run the simulations of a bag again and compare every message with those in the bag.

    A bag without a complete journal, or with nothing that the journal could prove, raises an
    UnverifiableError.
    """
    with open_received(path) as bag:
        return _verified(bag, report)


def _verified(bag: BagReader, report: Callable[[float], object]) -> Verification:
    proofs = [_Proof(bag, runs_of(bag, name), report) for name in held_journals(bag)]
    for proof in proofs:
        proof.run()
    begins = [proof.begins for proof in proofs if proof.begins is not None]
    differences = [each for proof in proofs for each in proof.differences]
    return Verification(
        {name: counts for proof in proofs for name, counts in proof.topics.items()},
        {name: lost for proof in proofs for name, lost in proof.lost.items()},
        min(differences, key=lambda difference: difference.log_time, default=None),
        next((proof.undecided for proof in proofs if proof.undecided), ""),
        sum(proof.simulated for proof in proofs),
        max(begins, default=None),
        tuple(dict.fromkeys(text for proof in proofs for text in proof.warnings)),
    )


class _Proof:
    """Proof of the runs of one drill."""

    def __init__(
        self, bag: BagReader, runs: Sequence[RecordedRun], report: Callable[[float], object]
    ) -> None:
        # As of a ``Verification``, of this drill alone.
        self.topics: dict[str, Counts] = {}
        self.lost: dict[str, int | None] = {}
        self.differences: list[MessageDifference] = []
        self.undecided = ""
        self.simulated = 0
        self._counted = Counter[int]()  # simulated time, by the number of the run [ns]
        self.warnings: list[str] = []
        self._bag, self._runs, self._report = bag, runs, report
        first = runs[0]
        prefix, self._journal = first.prefix, first.journal
        for run in runs:
            try:
                _ = run.plan
            except RecordingError as error:
                raise UnverifiableError(str(error)) from error
        late = first.entries[0].entry.sequence > 0
        self.begins = first.entries[0].stamp if late else None
        # By the names of topics in the run.
        self._summaries = {
            summary.topic.name.removeprefix(prefix): summary
            for summary in bag.topics
            if summary.topic.name.startswith(prefix)
        }
        self._codecs: dict[str, Codec] = {}
        for name in PROVED:
            if summary := self._summaries.get(name):
                # Another type matters only if there are messages of it.
                with nullcontext() if summary.message_count else suppress(UnverifiableError):
                    self._codecs[name] = _proof_codec(summary)
        if not any(self._summaries[name].message_count for name in self._codecs):
            raise UnverifiableError(f"the bag holds nothing that {self._journal} could prove")

    def run(self) -> None:
        for run in self._runs:
            if wrong := wrong_header(run.entries):
                place = self._journal, wrong.recorded.entry.time, wrong.recorded.log_time
                self.differences.append(
                    MessageDifference(*place, wrong.field, wrong.value, wrong.right)
                )
                return  # times that contradict each other may be any
        comparisons = self._compare()
        found = [suspect for each in comparisons.values() for suspect in each.suspects]
        open_ended = [doubt for run in self._runs if (doubt := run.doubt())]
        # The journal holds all that could explain the others.
        doubts = [self._runs[each.run - 1].doubt(each.published) for each in found]
        decided = [each for each, doubt in zip(found, doubts, strict=True) if not doubt]
        older = sum(
            c.counts["before"] for name, c in comparisons.items() if not TOPICS[name].latched
        )
        if open_ended:
            self.undecided = f"cannot be decided: {open_ended[0]}"
        elif found and not decided:
            self.undecided = f"{doubts[0]}. {len(found)} messages after it are not as computed"
        elif older:
            self.undecided = f"{older} messages are of before the journal begins"
        self.differences += [each.difference for each in decided]
        self._check_commands()
        for name, each in comparisons.items():
            summary, counts = self._summaries[name], Counts(**each.counts)
            if summary.message_count or counts.tail:
                self.topics[summary.topic.name] = counts
                self.lost[summary.topic.name] = summary.losses.total if summary.losses else None

    def _compare(self) -> dict[str, _TopicProof]:
        computed = TopicStreams(self._computed)
        recorded = TopicStreams(lambda topics: by_run(self._runs, self._bag.batches(topics)))
        began, complete = _began(self._bag, self._runs), _complete_from(self._bag, self._runs)
        proofs, readers = {}, []
        for name, codec in self._codecs.items():
            full = self._runs[0].topic(name)
            streams = computed.stream(full), recorded.stream(full)
            proofs[name] = _TopicProof(self._runs, began, complete)
            cursors = [StreamHead(stream, codec) for stream in streams]
            readers.append((proofs[name].compare(*cursors), streams))
        try:
            read_together(readers)
        except EngineError as error:
            raise UnverifiableError(f"{self._journal}: {error}") from error
        except RecordingError as error:
            raise UnverifiableError(str(error)) from error
        return proofs

    def _computed(self, topics: Collection[str]) -> Iterator[Batch]:
        """Compute the messages of all runs."""
        prefix = self._runs[0].prefix
        names = {topic.removeprefix(prefix) for topic in topics}
        for run in self._runs:
            # A block may end later.
            end = run.end if run.ended else run.end + _TAIL
            for batch in run.computed(end, names):
                block = batch.serialized(self._codecs[batch.topic])
                yield replace(block, topic=prefix + batch.topic)
                if (time := int(batch.publish_times[-1])) >= self._counted[run.number] + SECOND:
                    self._count(run, time)
            self._count(run, run.end)

    def _check_commands(self) -> None:
        """Warn if the drill took more commands than a bag with all of their topics holds."""
        status = self._summaries.get("status")
        held = [self._summaries.get(name) for name in ALL_COMMAND_TOPICS]
        if len(self._runs) > 1 or None in held[: len(COMMAND_TOPICS)]:
            return  # the counters may have begun again, or the commands were not to be recorded
        if status is None or not status.message_count or status.topic.type != TOPICS["status"].type:
            return
        first = next(iter(self._bag.messages({status.topic.name})))
        late = self._bag.messages({status.topic.name}, max(0, self._bag.duration - _END))
        last = deque(chain([first], late), maxlen=1)[0]
        with suppress(BagFormatError, TypeError):  # of another definition
            codec = Codec(status.topic.type, status.definition or "")
            before, after = codec.decode(first.data), codec.decode(last.data)
            taken = sum(getattr(after, each, 0) - getattr(before, each, 0) for each in _COUNTERS)
            count = sum(summary.message_count for summary in held if summary)
            if taken > count:
                self.warnings.append(
                    f"the drill took {taken} commands from the first to the last status, and the "
                    f"bag holds {count}"
                )

    def _count(self, run: RecordedRun, time: int) -> None:
        """Count what is simulated up to a time [ns], once though a stream may need its own pass."""
        simulated = min(time, run.end) - self._counted[run.number]
        if simulated > 0:
            self._counted[run.number] += simulated
            self.simulated += simulated
            self._report(simulated / SECOND)


def _proof_codec(summary: TopicSummary) -> Codec:
    """Return the codec of a topic whose type is the installed one."""
    topic = summary.topic
    expected = TOPICS[topic.name.rpartition("/")[2]].type
    if topic.type != expected:
        raise UnverifiableError(f"the type of {topic.name} is {topic.type:.80}, not {expected}")
    installed, installed_hash = installed_codec(expected), find_type_hash(expected)
    if topic.type_hash == installed_hash or not (topic.type_hash or summary.definition):
        return installed
    try:
        recorded = Codec(expected, summary.definition or "")
    except BagFormatError as error:
        raise UnverifiableError(f"{topic.name}: {error}") from None
    # Some writers give no hash. Messages of another length would differ, and nobody altered them.
    if (topic.type_hash or recorded.type_hash) != installed_hash:
        raise UnverifiableError(
            f"{topic.name} is of another version of {expected}{_lacking(recorded, installed)}"
        )
    return installed


def _lacking(recorded: Codec, installed: Codec) -> str:
    """Return which fields a recorded type lacks, as the end of a sentence."""
    held, known = ([name for name, _ in each.members.members] for each in (recorded, installed))
    fields = [name for name in known if name not in held]
    return f", without {', '.join(fields)}" if fields else ""


class _Suspect(NamedTuple):
    """Recorded message that its run does not give."""

    difference: MessageDifference  # how it differs
    run: int  # number of its run
    published: int  # when [ns]


class _TopicProof:
    """Comparison of one topic's computed messages with its recorded ones."""

    def __init__(
        self, runs: Sequence[RecordedRun], began: tuple[int, int], complete_from: tuple[int, int]
    ) -> None:
        self.counts = Counter[str]()  # as of ``Counts``
        self.suspects: list[_Suspect] = []
        self._runs, self._began, self._complete_from = runs, began, complete_from
        self._missing = 0  # computed messages skipped since the last recorded one

    def compare(self, computed: StreamHead, recorded: StreamHead) -> Iterator[None]:
        """Compare all messages, step by step."""
        for step in matched(computed, recorded):
            if step.equal:
                self._match("equal", step.equal)
                yield
            elif step.first is None:
                if step.second is not None:
                    self._unexpected(step.second)
                yield
            elif step.second is not None:
                self._pair(step.first, step.second)
            elif recorded.head() is not None:
                self._count_missing(step.first)
                yield
            elif self._is_after_the_end(step.first):
                return

    def _count_missing(self, computed: Head) -> None:
        run, time = self._runs[computed.run - 1], computed.publish_time
        begun = run.beginning.get("live_from", 0)
        if isinstance(begun, int) and time <= begun:
            return  # a live fork published nothing before it continued
        self._missing += time + run.origin <= run.computed_until  # it may have been killed
        if not self._matched and (computed.run, computed.stamp) >= self._began:
            self.counts["head"] += 1

    def _pair(self, computed: Head, recorded: Head) -> None:
        found = difference(recorded, computed)
        if found is None:
            self._match("equal", 1)
            return
        self._match("different", 1)
        self._suspect(computed.stamp, recorded, *found)

    def _match(self, result: str, count: int) -> None:
        """Count matched messages, and the missing ones between them and those before."""
        # Messages before a topic's first one were published before the recorder subscribed.
        if self._matched:
            self.counts["missing"] += self._missing
        self._missing = 0
        self.counts[result] += count

    @property
    def _matched(self) -> bool:
        return self.counts["equal"] + self.counts["different"] > 0

    def _unexpected(self, recorded: Head) -> None:
        if not recorded.run:
            self.counts["before"] += 1
            return
        self.counts["unexpected"] += 1
        self._suspect(recorded.stamp, recorded, "", "a message", None)

    def _is_after_the_end(self, computed: Head) -> bool:
        """Count a computed message after the last recorded one; whether the recording had ended."""
        run = self._runs[computed.run - 1]
        time = computed.publish_time + run.origin  # at the end of its block
        if time > run.computed_until:
            return True
        if self._matched or (computed.run, time) > self._complete_from:
            # Skipped ones lie before an unexpected message here, so they are missing at the end.
            self.counts["tail"] += self._missing * self._matched + 1
            self._missing = 0
        return False

    def _suspect(
        self, stamp: int, recorded: Head, field: str, value: str, computed: str | None
    ) -> None:
        if len(self.suspects) < _MOST_SUSPECTS:
            found = MessageDifference(
                recorded.topic, stamp, recorded.log_time, field, value, computed
            )
            self.suspects.append(_Suspect(found, recorded.run, recorded.publish_time))


def _began(bag: BagReader, runs: Sequence[RecordedRun]) -> tuple[int, int]:
    """Return run and stamp from which on messages are missing at the head of a topic [ns]."""
    readers = {
        name: reader
        for name, reader in progress_readers(bag, runs[0].prefix).items()
        if not TOPICS[short := name.removeprefix(runs[0].prefix)].latched
        and short not in _OF_BEFORE
    }
    shown = [_run_and_stamp(runs, f) for _, f in recorded_progress(bag, readers, 0, _TOPIC_DELAY)]
    number, stamp = min(shown, default=(len(runs) + 1, 0))
    forked = bool(runs[0].manifest and runs[0].manifest.forked_from)
    if forked or not 1 <= number <= len(runs):  # a fork begins within a block, as it should
        return len(runs) + 1, 0
    # Of the block in which the recording began, a topic may have come and another not.
    block = SECOND // max(1, int(runs[number - 1].parameters.get("telemetry_rate", 1)))
    at_start = stamp - runs[number - 1].origin <= block
    return number, 0 if at_start else stamp + block


def _run_and_stamp(runs: Sequence[RecordedRun], found: np.ndarray) -> tuple[int, int]:
    return sum(run.window[0] <= found["published"][0] for run in runs), int(found["stamp"][0])


def _complete_from(bag: BagReader, runs: Sequence[RecordedRun]) -> tuple[int, int]:
    """Return run and stamp from which on a bag should hold a topic that it holds at all [ns]."""
    readers = progress_readers(bag, runs[0].prefix)
    for _, found in recorded_progress(bag, readers, _TOPIC_DELAY):
        return _run_and_stamp(runs, found)
    return len(runs) + 1, 0
