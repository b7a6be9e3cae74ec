"""Answers that the nodes under test have declared: one step is over when all have come."""

from __future__ import annotations

import dataclasses

from rpud_sim.foundation.time import SECOND
from rpud_sim.testing.collector import Collector
from rpud_sim.testing.heard_topic import HeardTopic
from rpud_sim.testing.introductions import Introductions


@dataclasses.dataclass
class _Answer:
    name: str
    kind: str
    count: int
    topic: HeardTopic | None = None
    begun: int = 0  # messages before the step


class Answers:
    """Declared answers of the nodes under test.

    An answer to a step has the stamp that the step has reached, or a later one. A message without a
    stamp answers if it comes after the step has begun.
    """

    def __init__(self, collector: Collector, introductions: Introductions) -> None:
        self._collector = collector
        self._introductions = introductions
        self._answers: list[_Answer] = []
        self.introduced = False  # whether the nodes that answer know the test and the drill
        self.period = 0  # simulation time between two answers [ns]; 0 without answers
        self.timeout = 0.0  # longest real time for the answers to one step [s]

    @property
    def declared(self) -> bool:
        return bool(self._answers)

    @property
    def names(self) -> list[str]:
        return [answer.name for answer in self._answers]

    def declare(
        self, names: tuple[str, ...], kind: str = "", count: int = 1, period: int = 0
    ) -> None:
        """Declare topics with answers, in place of those before."""
        self.period = period if names else 0
        self.introduced = False
        self._introductions.renew()
        resolve = self._collector.resolve
        self._answers = [_Answer(resolve(name), kind, count) for name in names]

    def connect(self) -> bool:
        """Subscribe as far as publishers are there; return whether each topic has one."""
        for answer in self._answers:
            if answer.topic is None:
                answer.topic = self._collector.subscribe(answer.name, answer.kind)
                if answer.topic is not None:  # what nodes knew before is not enough
                    self._introductions.renew()
        return all(self._publishers(answer) for answer in self._answers)

    @property
    def publishers(self) -> dict[bytes, str]:
        """Living publishers of all answers, by their identifiers, with the names of their nodes."""
        return {gid: name for each in self._answers for gid, name in self._publishers(each).items()}

    def crowded(self) -> str:
        """Return a phrase for a topic with more publishers than awaited messages; empty if none."""
        for answer in self._answers:
            if answer.topic and answer.topic.subscription.get_publisher_count() > answer.count:
                names = sorted(name or "a node" for name in self._publishers(answer).values())
                if len(names) > answer.count:
                    return (
                        f"{answer.name} has {len(names)} publishers, {' and '.join(names)}, and "
                        f"count={answer.count} awaits as many messages: give count={len(names)}"
                    )
        return ""

    def begin(self) -> None:
        """Begin a step: what has come until now is no answer to it."""
        for answer in self._answers:
            answer.begun = len(answer.topic) if answer.topic else 0

    def missing(self, stamp: int) -> list[str]:
        """Return a phrase for each topic that has not answered for a stamp [ns]."""
        return [
            self._lack(answer, stamp) for answer in self._answers if not _answered(answer, stamp)
        ]

    @property
    def never(self) -> bool:
        """Whether a topic has had no message at all."""
        return any(answer.topic is None or not len(answer.topic) for answer in self._answers)

    def late(self, stamp: int) -> bool:
        """Return whether what is missing has come at all since the step began."""
        return any(
            answer.topic is not None and len(answer.topic) > answer.begun
            for answer in self._answers
            if not _answered(answer, stamp)
        )

    def _publishers(self, answer: _Answer) -> dict[bytes, str]:
        if answer.topic is None or not answer.topic.subscription.get_publisher_count():
            return {}
        return self._introductions.publishers(answer.name)

    def _lack(self, answer: _Answer, stamp: int) -> str:
        topic = answer.topic
        if topic is None:
            return f"{answer.name}, which has no publisher"
        if not len(topic):
            return f"{answer.name}, which has published nothing"
        if not topic.stamped:
            return f"{answer.name}: {len(topic) - answer.begun} of {answer.count} messages"
        return f"{answer.name}, whose last answer is for {topic.stamps[-1] / SECOND:.3f} s"


def _answered(answer: _Answer, stamp: int) -> bool:
    topic = answer.topic
    if topic is None:
        return False
    since = topic.stamps[answer.begun :]
    if topic.stamped:
        since = [each for each in since if each >= stamp]
    return len(since) >= answer.count
