"""A bag beside the simulation that its journal tells of, run again, in bounded memory."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import rpud_sim.bag
from rpud_sim.bag import BagFormatError, BagReader, Message, Topic, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.verify.comparison import Counts, Difference, Suspect, TopicComparison
from rpud_sim.inspection.verify.content import ContentComparison
from rpud_sim.inspection.verify.coverage import find_coverage
from rpud_sim.inspection.verify.entries import UnverifiableError, entries
from rpud_sim.inspection.verify.runs import BEGINNINGS, Position, Stretches
from rpud_sim.simulation import EngineError
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.rerun import JournalError, Rerun
from rpud_sim.simulation.topics import PROVED, TOPICS
from rpud_sim.simulation.versions import engine_and_processor

_JOURNAL = TOPICS["journal"].type
# The simulation goes on this long after the last stamp: a block may end later [ns].
_TAIL = 2 * SECOND


@dataclass(frozen=True)
class Verification:
    """What came of it.

    Args:
        topics: what was found on each topic, by its name.
        lost: what its recorder knows to have lost on each of them, None where nobody counted.
        first_difference: by the bag's clock, of a message that no run gives; None if there is none.
        undecided: why it cannot be decided whether messages differ, a line; empty if it can.
        simulated: simulation time that was run again [ns].
        warnings: what else is to be said, a line each.
        other_versions: whether something else made the bag than what verified it.
    """

    topics: dict[str, Counts]
    lost: dict[str, int | None]
    first_difference: Difference | None
    undecided: str
    simulated: int
    warnings: tuple[str, ...]
    other_versions: bool

    @property
    def proved(self) -> bool:
        """Whether every message is what the simulation gives, and none is missing at the end."""
        return not (self.first_difference or self.undecided or self.tail)

    @property
    def tail(self) -> int:
        """Number of messages that are missing at the end, of all topics."""
        return sum(counts.tail for counts in self.topics.values())


def verify(
    path: str | os.PathLike[str], report: Callable[[float], object] = lambda seconds: None
) -> Verification:
    """Run the simulations of a bag again and compare every message that they gave.

    Args:
        path: of the bag.
        report: told the seconds that were simulated since it was told last.

    Raises:
        BagError: if the bag cannot be read.
        UnverifiableError: if it holds no whole journal, or nothing that it could prove.
    """
    with rpud_sim.bag.open(path) as bag:
        journals = [summary for summary in bag.topics if summary.topic.type == _JOURNAL]
        held = [summary for summary in journals if summary.message_count]
        if not held:
            raise UnverifiableError(
                f"{path} holds no journal; record the topic journal, or all of the namespace"
            )
        parts = [_Proof(bag, journal).run(report) for journal in held]
    differences = [part.first_difference for part in parts if part.first_difference]
    return Verification(
        {name: counts for part in parts for name, counts in part.topics.items()},
        {name: lost for part in parts for name, lost in part.lost.items()},
        min(differences, key=lambda difference: difference.log_time, default=None),
        next((part.undecided for part in parts if part.undecided), ""),
        sum(part.simulated for part in parts),
        tuple(dict.fromkeys(text for part in parts for text in part.warnings)),
        any(part.other_versions for part in parts),
    )


class _Proof:
    """The proof of one namespace."""

    def __init__(self, bag: BagReader, journal: TopicSummary) -> None:
        self._bag = bag
        self._journal = journal.topic.name
        self._codec = _codec(journal)
        prefix = self._journal[: -len("journal")]
        self._summaries = {
            summary.topic.name.removeprefix(prefix): summary
            for summary in bag.topics
            if summary.topic.name.startswith(prefix)
        }
        self._names = [
            name
            for name in PROVED
            if name in self._summaries
            and (self._summaries[name].message_count or _fits(self._summaries[name].topic))
        ]
        if not any(self._summaries[name].message_count for name in self._names):
            raise UnverifiableError(f"the bag holds nothing that {self._journal} could prove")
        self._warnings: dict[str, None] = {}
        self._other_versions = False
        self._simulated = 0

    def run(self, report: Callable[[float], object]) -> Verification:
        self._stretches = Stretches(self._entries())
        codecs = {
            self._summaries[name].topic.name: _codec(self._summaries[name]) for name in self._names
        }
        status = self._summaries.get("status")
        if status and status.topic.type == TOPICS["status"].type and status.definition:
            with contextlib.suppress(BagFormatError):
                # Any version of it shows how far the drill has come.
                codecs[status.topic.name] = Codec(TOPICS["status"].type, status.definition)
        self._coverage = find_coverage(self._bag, codecs, self._stretches)
        comparisons = self._compare(report)
        counts = {name: comparison.counts for name, comparison in comparisons.items()}
        suspects = {name: c.suspects for name, c in comparisons.items() if c.suspects}
        found = [group[0].difference for group in suspects.values()]
        undecided = ""
        if suspects and self._stretches.runs > 1:
            found = self._decide(suspects, counts, report)
            left = [name for name in suspects if counts[name].different + counts[name].unexpected]
            if left and not found:
                undecided = (
                    f"the bag holds {self._stretches.runs} runs, and it cannot be decided which "
                    f"of them messages of {self._summaries[left[0]].topic.name} belong to"
                )
        held = [
            name for name in self._names if self._summaries[name].message_count or counts[name].tail
        ]
        losses = {name: self._summaries[name].losses for name in held}
        return Verification(
            {self._summaries[name].topic.name: counts[name] for name in held},
            {
                self._summaries[name].topic.name: None if lost is None else lost.total
                for name, lost in losses.items()
            },
            min(found, key=lambda difference: difference.log_time, default=None),
            undecided,
            self._simulated,
            tuple(self._warnings),
            self._other_versions,
        )

    def _compare(self, report: Callable[[float], object]) -> dict[str, TopicComparison]:
        """Compare each message with those of the run that it was published in."""
        comparisons = {
            name: TopicComparison(
                self._summaries[name].topic.name,
                _codec(self._summaries[name]),
                self._messages(name),
                self._stretches,
                self._coverage.span,
            )
            for name in self._names
        }
        for name, values, position in self._computed(report):
            if name in comparisons:
                comparisons[name].add(values, position)
                if position > self._coverage.span.reached and all(
                    comparison.exhausted for comparison in comparisons.values()
                ):
                    break
        for comparison in comparisons.values():
            comparison.finish()
        return comparisons

    def _decide(
        self,
        suspects: Mapping[str, Sequence[Suspect]],
        counts: dict[str, Counts],
        report: Callable[[float], object],
    ) -> list[Difference]:
        """Look for suspects in all runs; return the differences of those that no run gives.

        Times may mislead: another recorder does not keep when messages were published, or the
        clock was set back. The counts of a topic are corrected if its messages prove themselves.
        """
        simulated = self._simulated
        contents = {
            name: ContentComparison(group, _codec(self._summaries[name]), self._messages(name))
            for name, group in suspects.items()
        }
        for name, values, _ in self._computed(report):
            if name in contents:
                contents[name].add(values)
        self._simulated = simulated
        for name, content in contents.items():
            if content.in_order:
                counts[name] = Counts(equal=content.equal)
                self._warnings[
                    "times in the bag do not show which run messages belong to: they are matched "
                    "by content, and missing ones are not counted"
                ] = None
        return [
            difference
            for content in contents.values()
            if not content.in_order
            for difference in content.strangers
        ]

    def _computed(
        self, report: Callable[[float], object]
    ) -> Iterator[tuple[str, dict[str, Any], Position]]:
        """Yield what the simulation gives: topic, message, and where the drill stands then."""
        rerun = Rerun()
        stretch = -1
        try:
            for _, entry in self._entries():
                before = rerun.time
                if entry.kind in BEGINNINGS:
                    stretch += 1
                if entry.kind == "begin":
                    self._check_versions(entry.content)
                    before = 0
                for _, name, values in rerun.repeat(entry):
                    yield name, values, (stretch, rerun.origin + rerun.time)
                self._count(rerun.time - before, report)
            if entry.kind == "end":
                return
            # The recording ended before the drill did.
            last = self._coverage.last_stamp + _TAIL - rerun.origin
            while rerun.time < last:
                before = rerun.time
                for _, name, values in rerun.advance_to(min(before + SECOND, last)):
                    yield name, values, (stretch, rerun.origin + rerun.time)
                self._count(rerun.time - before, report)
        except (JournalError, EngineError) as error:
            raise UnverifiableError(f"{self._journal}: {error}") from error

    def _entries(self) -> Iterator[tuple[Message, JournalEntry]]:
        return entries(self._bag.messages({self._journal}), self._codec)

    def _messages(self, name: str) -> Iterator[Message]:
        return self._bag.messages({self._summaries[name].topic.name})

    def _count(self, simulated: int, report: Callable[[float], object]) -> None:
        self._simulated += simulated
        report(simulated / SECOND)

    def _check_versions(self, content: Any) -> None:
        own = engine_and_processor()
        made_by = content.get("made_by", {})
        for name, version in own.items():
            other = made_by.get(name, "unknown") if isinstance(made_by, dict) else "unknown"
            if other != version:
                self._other_versions = True
                self._warnings[f"made by {name} {other!s:.80}, verified by {version}"] = None


def _codec(summary: TopicSummary) -> Codec:
    """The codec of a topic whose type is the one that is installed here."""
    topic = summary.topic
    expected = _expected_type(topic)
    if topic.type != expected:
        raise UnverifiableError(f"the type of {topic.name} is {topic.type:.80}, not {expected}")
    if not _fits(topic):
        raise UnverifiableError(f"{topic.name} is of another version of {expected}")
    return _own_codec(expected)


def _expected_type(topic: Topic) -> str:
    own = TOPICS.get(topic.name.rpartition("/")[2])
    return _JOURNAL if topic.type == _JOURNAL or own is None else own.type


def _fits(topic: Topic) -> bool:
    """Whether a topic's type is the one that is installed here."""
    expected = _expected_type(topic)
    return topic.type == expected and topic.type_hash in ("", find_type_hash(expected))


@cache
def _own_codec(type_name: str) -> Codec:
    return Codec(type_name, find_definition(type_name))
