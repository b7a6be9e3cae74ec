"""Verification of a bag: its journal is run again and every message compared, in bounded memory."""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext, suppress
from dataclasses import astuple, dataclass
from functools import cached_property
from itertools import chain

import rpud_sim.bag
from rpud_sim.bag import BagFormatError, BagReader, Message, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.recorded_journal import (
    Recorded,
    RecordedJournal,
    UnverifiableError,
    held_journals,
    proof_codec,
)
from rpud_sim.inspection.recorded_topics import RecordedMessages, RecordedTopics
from rpud_sim.inspection.verify.coverage import (
    BEGINNINGS,
    JournalStretches,
    Position,
    find_coverage,
)
from rpud_sim.inspection.verify.messages import (
    ComputedBlock,
    computed_blocks,
    first_difference,
    key_of,
    without_padding,
)
from rpud_sim.inspection.verify.topic_comparison import (
    ContentComparison,
    Counts,
    MessageDifference,
    Suspect,
    TopicComparison,
)
from rpud_sim.simulation import EngineError
from rpud_sim.simulation.fields import faults_fields, header_fields
from rpud_sim.simulation.journal import STARTS
from rpud_sim.simulation.rerun import JournalError, Rerun
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.telemetry import Entry, Together
from rpud_sim.simulation.topics import ALL_COMMAND_TOPICS, COMMAND_TOPICS, PROVED, TOPICS, Fields
from rpud_sim.simulation.versions import other_engine

# Time that is simulated beyond the last stamp: a block may end later [ns].
_TAIL = 2 * SECOND
_COUNTERS = ("commands_accepted", "commands_rejected", "commands_discarded")  # of a status
_LAST_STATUS = 10 * SECOND  # of a bag, in which a living drill has published a status [ns]


@dataclass(frozen=True)
class Verification:
    """Result of re-running a bag's journal."""

    topics: dict[str, Counts]  # results of each topic, by its name
    # messages that the recorder counted as lost, by topic; None if it did not count
    lost: dict[str, int | None]
    # by the bag's clock, of a message that no run gives; None if all agree
    first_difference: MessageDifference | None
    undecided: str  # why it cannot be decided whether messages differ, one line; empty if it can
    simulated: int  # simulation time that was run again [ns]
    # stamp from which on messages are compared [ns]; None if the journal has the drill's start
    begins: int | None
    warnings: tuple[str, ...]  # one line each

    @property
    def proved(self) -> bool:
        """Whether every message is what the simulation gives, and none is missing at the end."""
        return not (self.first_difference or self.undecided or self.total.tail)

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
    with rpud_sim.bag.open(path) as bag:
        proofs = [_Proof(bag, journal, report) for journal in held_journals(bag).values()]
        for proof in proofs:
            proof.run()
    begins = [proof.begins[0] for proof in proofs if proof.begins]
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
    """Proof of what one journal of a bag determines."""

    def __init__(
        self, bag: BagReader, journal: TopicSummary, report: Callable[[float], object]
    ) -> None:
        # As of a ``Verification``, of this journal alone.
        self.topics: dict[str, Counts] = {}
        self.lost: dict[str, int | None] = {}
        self.differences: list[MessageDifference] = []
        self.undecided = ""
        self.simulated = 0
        self.warnings: list[str] = []
        self._bag = bag
        self._report = report
        self._recorded = RecordedJournal(bag, journal)
        self._journal, prefix = self._recorded.name, self._recorded.prefix
        self._first_faults: Fields = {}  # of the state with which a late recording begins
        self._stretches = JournalStretches(self._entries())  # first: it refuses another engine
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
                    self._codecs[name] = proof_codec(summary)
        if not any(self._summaries[name].message_count for name in self._codecs):
            raise UnverifiableError(f"the bag holds nothing that {self._journal} could prove")
        self._coverage = find_coverage(bag, self._recorded, self._stretches)

    def run(self) -> None:
        if wrong := self._stretches.wrong:
            self._add_difference(*wrong)
            return  # times that contradict each other may be any
        comparisons = self._compare()
        counts = {name: comparison.counts for name, comparison in comparisons.items()}
        found = [suspect for each in comparisons.values() for suspect in each.suspects]
        if found and self._stretches.runs > 1:
            found = self._decide(comparisons, counts)
            left = [n for n in comparisons if counts[n].different + counts[n].unexpected]
            if left and not found:
                self.undecided = (
                    f"the bag holds {self._stretches.runs} runs, and it cannot be decided which "
                    f"of them messages of {self._summaries[left[0]].topic.name} belong to"
                )
        until = self._coverage.journal_until
        decided = [each for each in found if until is None or each.published <= until]
        older = sum(counts[name].before for name in counts if not TOPICS[name].latched)
        if found and not decided:
            held, counted = self._stretches.count, self._coverage.journal_count
            self.undecided = (
                f"the journal ends early: the bag holds {held} of its entries, and a status "
                f"counts {counted or 'none'}. {len(found)} messages after it are not as computed"
            )
        elif not self.undecided and older:
            self.undecided = f"{older} messages are of before the journal begins"
        self.differences += [each.difference for each in decided]
        if "faults" in comparisons:
            self._check_older_faults(comparisons["faults"].older)
        self._check_commands()
        for name, each in counts.items():
            summary = self._summaries[name]
            if summary.message_count or each.tail:
                self.topics[summary.topic.name] = each
                self.lost[summary.topic.name] = summary.losses.total if summary.losses else None

    def _compare(self) -> dict[str, TopicComparison]:
        recorded = RecordedTopics(self._bag)
        blocks_of = {
            name: recorded.blocks(self._summaries[name].topic.name) for name in self._codecs
        }
        comparisons = {
            name: TopicComparison(
                codec,
                RecordedMessages(blocks_of[name]),
                self._stretches,
                self._coverage,
                TOPICS[name].latched,
                self.begins,
            )
            for name, codec in self._codecs.items()
        }
        for blocks, position in self._computed():
            for block in blocks:
                comparisons[block.messages.topic].add(block)
            if position > self._coverage.reached and all(
                comparison.exhausted for comparison in comparisons.values()
            ):
                break
        for comparison in comparisons.values():
            comparison.finish()
        return comparisons

    def _decide(
        self, comparisons: Mapping[str, TopicComparison], counts: dict[str, Counts]
    ) -> list[Suspect]:
        """Look for suspects in all runs; return those that no run gives.

        Times may mislead: other recorders do not keep publishing times, or the clock was set back.
        If the content of a topic's messages proves all of them, its counts are corrected.
        """
        simulated = self.simulated
        contents = {
            name: ContentComparison(
                comparison.suspects,
                self._codecs[name],
                self._bag.messages({self._summaries[name].topic.name}),
                TOPICS[name].latched,
            )
            for name, comparison in comparisons.items()
            if comparison.suspects
        }
        for blocks, _ in self._computed():
            for messages in (block.messages for block in blocks):
                if messages.topic in contents:
                    for number in range(len(messages)):
                        contents[messages.topic].add(messages.message(number))
        self.simulated = simulated
        unmatched: list[Suspect] = []
        for name, content in contents.items():
            if not content.in_order:
                unmatched += content.unmatched
                continue
            counts[name] = Counts(equal=content.equal)
            self.warnings.append(
                "times in the bag do not show which run messages belong to: they are matched "
                "by content, and missing ones are not counted"
            )
        return unmatched

    def _computed(self) -> Iterator[tuple[Iterator[ComputedBlock], Position]]:
        """Yield computed messages, and the progress of the drill at their end."""
        rerun = Rerun()
        stretch = -1

        def blocks(
            messages: Iterable[Entry | Together],
        ) -> Iterator[tuple[Iterator[ComputedBlock], Position]]:
            for found in messages:
                reached = rerun.origin + rerun.time
                yield computed_blocks(found, self._codecs, stretch, reached), (stretch, reached)

        try:
            for recorded in self._entries():
                entry, before = recorded.entry, rerun.time
                if entry.kind in BEGINNINGS or stretch < 0:
                    stretch += 1
                if entry.kind == "begin":
                    before = 0
                known = rerun.run
                if entry.kind == "state" and known is None:
                    before = entry.time
                yield from blocks(rerun.repeat(entry))
                if entry.kind == "state" and known is not None:
                    self._compare_state(recorded, known)
                elif entry.kind == "state" and rerun.run is not None:
                    faults = rerun.run.simulation.faults
                    self._first_faults = faults_fields(faults, rerun.time, rerun.origin)
                # A restored checkpoint takes the time back.
                self._count((entry.time if entry.kind == "restore" else rerun.time) - before)
            if entry.kind == "end":
                return
            # The recording ended before the drill did.
            last = self._coverage.last_stamp + _TAIL - rerun.origin
            while rerun.time < last:
                before = rerun.time
                yield from blocks(rerun.advance_to(min(before + SECOND, last)))
                self._count(rerun.time - before)
        except (JournalError, EngineError) as error:
            raise UnverifiableError(f"{self._journal}: {error}") from error

    @cached_property
    def begins(self) -> tuple[int, int] | None:
        """Return stamp and publishing time of the first entry; None if it is the drill's first."""
        assert self._stretches.first is not None
        first = self._stretches.first
        return (first.stamp, first.message.publish_time) if first.entry.sequence else None

    def _compare_state(self, recorded: Recorded, run: Run) -> None:
        # As texts, for NaN is not itself. The faults are published before or after the entry.
        texts = []
        for state in (run.state(), recorded.entry.content.get("state")):
            told = state if isinstance(state, dict) else {}
            texts.append(json.dumps({**told, "faults_published": None}, sort_keys=True))
        if texts[0] != texts[1]:
            self._add_difference(recorded, "state", "a state", "another one")

    def _check_older_faults(self, older: Message | None) -> None:
        """Compare the faults that a late recorder got first with those of the first state."""
        if older is None or not self._first_faults:
            return  # a journal that begins with a run has no state of before
        codec = self._codecs["faults"]
        stamp = key_of(older.data, codec)[0]
        expected = codec.encode({**self._first_faults, "header": header_fields("faults", stamp)})
        if without_padding(older.data, codec) != expected:
            found = first_difference(codec, older.data, expected)
            self.differences.append(MessageDifference(older.topic, stamp, older.log_time, *found))

    def _check_commands(self) -> None:
        """Warn if the drill took more commands than a bag with all of their topics holds."""
        status = self._summaries.get("status")
        codec = self._recorded.codecs.get(status.topic.name) if status else None
        held = [self._summaries.get(name) for name in ALL_COMMAND_TOPICS]
        if self._stretches.runs > 1 or None in held[: len(COMMAND_TOPICS)]:
            return  # the counters may have begun again, or the commands were not to be recorded
        if status is None or codec is None or not status.message_count:
            return
        first = next(iter(self._bag.messages({status.topic.name})))
        late = self._bag.messages({status.topic.name}, max(0, self._bag.duration - _LAST_STATUS))
        last = deque(chain([first], late), maxlen=1)[0]
        with suppress(BagFormatError, TypeError):  # of another definition
            before, after = codec.decode(first.data), codec.decode(last.data)
            taken = sum(getattr(after, each, 0) - getattr(before, each, 0) for each in _COUNTERS)
            count = sum(summary.message_count for summary in held if summary)
            if taken > count:
                self.warnings.append(
                    f"the drill took {taken} commands from the first to the last status, and the "
                    f"bag holds {count}"
                )

    def _add_difference(self, recorded: Recorded, field: str, value: str, computed: str) -> None:
        place = self._journal, recorded.entry.time, recorded.message.log_time
        self.differences.append(MessageDifference(*place, field, value, computed))

    def _entries(self) -> Iterator[Recorded]:
        for recorded in self._recorded.entries():
            entry = recorded.entry
            if entry.kind in STARTS:
                held = entry.content
                beginning = held if entry.kind == "begin" else held.get("beginning")
                if reason := other_engine(beginning):
                    raise UnverifiableError(f"{self._journal}: {reason}")
            yield recorded

    def _count(self, simulated: int) -> None:
        self.simulated += simulated
        self._report(simulated / SECOND)
