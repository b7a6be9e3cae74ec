"""Expectations on what a drill has published so far."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rpud_sim.foundation.quantities import ParameterError, short_repr
from rpud_sim.testing.collector import StoredTopic
from rpud_sim.testing.computed import ComputedTopic
from rpud_sim.testing.errors import ExpectationFailedError, ExpectationUndecidedError
from rpud_sim.verdicts import (
    Expectation,
    Formula,
    Record,
    Verdict,
    evaluate,
    read_expectations,
)
from rpud_sim.verdicts.formulas import Eventually
from rpud_sim.verdicts.notation import to_text
from rpud_sim.verdicts.units import Window
from rpud_sim.verdicts.verdict import FAILED, latest_values

Expectable = Expectation | Formula | str | Path


class LiveVerdicts:
    """Verdicts on a drill that continues."""

    def __init__(self, namespace: str, topic: Callable[[str], StoredTopic | ComputedTopic]) -> None:
        self._namespace = namespace
        self._topic = topic
        self.begin()

    def begin(self) -> None:
        """Forget everything: a test begins."""
        self.verdicts: list[Verdict] = []  # all since the test began
        self.reset()

    def reset(self) -> None:
        """Judge only what comes from now on."""
        self._record = Record(self._namespace)
        self._added: dict[str, int] = {}  # messages, by topic
        self._lost: dict[str, int] = {}  # messages, by topic

    def expectations(
        self, given: Sequence[Expectable], folder: Path | None, name: str, requirement: str
    ) -> list[Expectation]:
        """Return expectations: formulas get a name, files are read."""
        found: list[Expectation] = []
        for each in given:
            if isinstance(each, Expectation):
                found.append(each)
            elif isinstance(each, Formula):
                found.append(Expectation(name or to_text(each), each, requirement))
            elif isinstance(each, str | Path):
                found += read_expectations((folder or Path()) / each)
            else:
                raise ParameterError(
                    f"{short_repr(each)} is neither an expectation, nor a file of some"
                )
        return found

    def expect(
        self, expectations: Sequence[Expectation], time: float, refusals: Callable[[], str]
    ) -> tuple[Verdict, ...]:
        """Evaluate expectations, at a simulation time [s], and return the verdicts.

        ``refusals`` returns a line about rejected commands for an error, empty without any.
        """
        record = self._filled(expectations)
        verdicts = tuple(evaluate(expectation, record) for expectation in expectations)
        self.verdicts += verdicts
        failed = [verdict for verdict in verdicts if not verdict.passed]
        if failed:
            lines = [verdict_line(verdict) for verdict in failed]
            lines[0] += f" (evaluated at {time:.3f} s)"
            decided = any(verdict.outcome == FAILED for verdict in failed)
            kind = ExpectationFailedError if decided else ExpectationUndecidedError
            raise kind("\n".join(filter(None, [*lines, refusals()])), verdicts)
        return verdicts

    def eventually(self, formula: Formula, begun: int) -> Callable[[], bool]:
        """Return whether a formula has held at some instant since a simulation time [ns]."""
        expectation = Expectation(to_text(formula), Eventually(formula, Window(begun)))

        def holds() -> bool:
            return evaluate(expectation, self._filled([expectation])).passed

        return holds

    def latest_values(self, formula: Formula) -> str:
        """Return the latest values of the signals of a formula that does not hold."""
        expectation = Expectation(to_text(formula), formula)
        return latest_values(expectation, self._filled([expectation]))

    def _filled(self, expectations: Sequence[Expectation]) -> Record:
        for topic in sorted({topic for each in expectations for topic in each.topics}):
            heard = self._topic(topic)
            begin = self._added.get(topic, 0)
            if isinstance(heard, ComputedTopic):
                batches = heard.batches
                for batch in batches[begin:]:
                    self._record.add_batch(batch)
                self._added[topic] = len(batches)
                continue
            messages = heard.messages()
            for stamp, message in zip(heard.stamps[begin:], messages[begin:], strict=True):
                self._record.add(topic, stamp, message)
            self._added[topic] = len(messages)
            lost = heard.lost - self._lost.get(topic, 0)
            if lost:
                self._record.add_losses(topic, lost)
                self._lost[topic] = heard.lost
        return self._record


def verdict_line(verdict: Verdict) -> str:
    """Return a verdict as one line; a failed one has values in its text instead of a margin."""
    requirement = f"[{verdict.requirement}] " if verdict.requirement else ""
    margin = ""
    if verdict.passed and verdict.margin is not None:
        margin = f", margin {verdict.margin:.6g} {verdict.unit}".rstrip()
    return f"{requirement}{verdict.name}: {verdict.outcome}{margin}: {verdict.text}"
