"""A bag beside the simulation that its journal tells of, run again, in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import rpud_sim.bag
from rpud_sim.analysis.proof.comparison import Counts, Difference, TopicComparison
from rpud_sim.analysis.proof.entries import UnverifiableError, entries
from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.simulation import EngineError
from rpud_sim.simulation.rerun import JournalError, Rerun
from rpud_sim.simulation.sampling import NANOSECONDS
from rpud_sim.simulation.topics import PROVED, TOPICS
from rpud_sim.simulation.versions import engine_and_processor

_JOURNAL = TOPICS["journal"].type
_BEGINNINGS = ("begin", "origin")
# The simulation goes on this long after the last stamp: a block may end later [ns].
_TAIL = 2 * NANOSECONDS
# Of the bag, in which that stamp is looked for [ns].
_LAST = 10 * NANOSECONDS


@dataclass(frozen=True)
class Verification:
    """What came of it.

    Args:
        topics: what was found on each topic, by its name.
        lost: what its recorder knows to have lost on each of them, None where nobody counted.
        first_difference: by the bag's clock; None if there is none.
        simulated: simulation time that was run again [ns].
        warnings: what else is to be said, a line each.
        other_versions: whether something else made the bag than what verified it.
    """

    topics: dict[str, Counts]
    lost: dict[str, int | None]
    first_difference: Difference | None
    simulated: int
    warnings: tuple[str, ...]
    other_versions: bool

    @property
    def proved(self) -> bool:
        """Whether every message is what the simulation gives."""
        return self.first_difference is None


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
            if name in self._summaries and self._summaries[name].message_count
        ]
        if not self._names:
            raise UnverifiableError(f"the bag holds nothing that {self._journal} could prove")
        self._warnings: dict[str, None] = {}
        self._simulated = 0

    def run(self, report: Callable[[float], object]) -> Verification:
        stretches = self._stretches()
        comparisons = {
            name: TopicComparison(
                self._summaries[name].topic.name,
                _codec(self._summaries[name]),
                self._bag.messages({self._summaries[name].topic.name}),
                stretches,
            )
            for name in self._names
        }
        try:
            for name, values, stretch in self._computed(report):
                if name in comparisons:
                    comparisons[name].add(values, stretch)
                    if all(comparison.exhausted for comparison in comparisons.values()):
                        break
        except (JournalError, EngineError) as error:
            raise UnverifiableError(f"{self._journal}: {error}") from error
        for comparison in comparisons.values():
            comparison.finish()
        found = [c.first_difference for c in comparisons.values() if c.first_difference]
        losses = {name: self._summaries[name].losses for name in self._names}
        return Verification(
            {self._summaries[name].topic.name: comparisons[name].counts for name in self._names},
            {
                self._summaries[name].topic.name: None if lost is None else lost.total
                for name, lost in losses.items()
            },
            min(found, key=lambda difference: difference.log_time, default=None),
            self._simulated,
            tuple(self._warnings),
            bool(self._warnings),
        )

    def _computed(
        self, report: Callable[[float], object]
    ) -> Iterator[tuple[str, dict[str, Any], int]]:
        """Yield what the simulation gives: topic, message, and number of the stretch."""
        rerun = Rerun()
        stretch = -1
        for _, entry in self._entries():
            before = rerun.time
            if entry.kind in _BEGINNINGS:
                stretch += 1
            if entry.kind == "begin":
                self._check_versions(entry.content)
                before = 0
            for item in rerun.do(entry):
                yield item[1], item[2], stretch
            self._count(rerun.time - before, report)
        if entry.kind == "end":
            return
        # The recording ended before the drill did.
        last = self._last_stamp() + _TAIL - rerun.origin
        while rerun.time < last:
            before = rerun.time
            for item in rerun.advance_to(min(before + NANOSECONDS, last)):
                yield item[1], item[2], stretch
            self._count(rerun.time - before, report)

    def _entries(self) -> Iterator[Any]:
        return entries(self._bag.messages({self._journal}), self._codec)

    def _stretches(self) -> tuple[int, ...]:
        """When each stretch of one origin of time began, by the bag's clock [ns]."""
        return tuple(
            message.log_time for message, entry in self._entries() if entry.kind in _BEGINNINGS
        )

    def _last_stamp(self) -> int:
        """The last stamp that at least two topics come to, so that an altered one is not it."""
        latest: dict[str, int] = {}
        codecs = {
            self._summaries[name].topic.name: _codec(self._summaries[name]) for name in self._names
        }
        start = max(0, self._bag.duration - _LAST)
        for message in self._bag.messages(codecs.keys(), start):
            try:
                stamp = codecs[message.topic].decode(message.data).header.stamp
            except BagFormatError:
                continue
            latest[message.topic] = stamp.sec * NANOSECONDS + stamp.nanosec
        return min(sorted(latest.values())[-2:], default=0)

    def _count(self, simulated: int, report: Callable[[float], object]) -> None:
        self._simulated += simulated
        report(simulated / NANOSECONDS)

    def _check_versions(self, content: Any) -> None:
        own = engine_and_processor()
        made_by = content.get("made_by", {})
        for name, version in own.items():
            other = made_by.get(name, "unknown") if isinstance(made_by, dict) else "unknown"
            if other != version:
                self._warnings[f"made by {name} {other!s:.80}, verified by {version}"] = None


def _codec(summary: TopicSummary) -> Codec:
    """The codec of a topic whose type is the one that is installed here."""
    topic = summary.topic
    expected = TOPICS[topic.name.rpartition("/")[2]].type if topic.type != _JOURNAL else topic.type
    if topic.type != expected:
        raise UnverifiableError(f"the type of {topic.name} is {topic.type:.80}, not {expected}")
    if topic.type_hash not in ("", find_type_hash(expected)):
        raise UnverifiableError(f"{topic.name} is of another version of {expected}")
    return _own_codec(expected)


@cache
def _own_codec(type_name: str) -> Codec:
    return Codec(type_name, find_definition(type_name))
