"""Shaken runs of a test: the same test again, with its nodes disturbed, must do the same.

pytest runs a test's attempts as one test with one outcome. The first run is not disturbed, and
the others are compared with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import pytest
from _pytest.runner import call_and_report

from rpud_sim.foundation.time import SECOND
from rpud_sim.testing.item_drills import ATTEMPT

if TYPE_CHECKING:
    from rpud_sim.testing.attempt_records import Difference, DrillRecord
    from rpud_sim.testing.drill import LockstepDrill


class Attempt:
    """Attempt of a test: the first one, number 0, or one of ``count`` shaken ones."""

    def __init__(self, test: str, seed: int, count: int, first: Attempt | None = None) -> None:
        self.number = 0
        self.difference = ""  # from the first run, as some lines; empty without any
        self.named = False  # whether the test failed by this text alone
        self._test, self._seed, self._count = test, seed, count
        self._first = first
        self._taken = 0  # drills
        self._records: list[DrillRecord] = []  # of the drills, once it has landed

    @property
    def text(self) -> str:
        """Name of a shaken run, its difference, and how to repeat it."""
        name = f"shaken run {self.number} of {self._count} (seed {self._seed})"
        again = f"to repeat it: --rpud-shake {self._count} --rpud-shake-seed {self._seed}"
        failed = [] if self.named else ["the test failed only here"]
        return f"{name}: " + "\n".join([*failed, *filter(None, [self.difference]), again])

    @property
    def last(self) -> bool:
        """Whether no attempt follows: it took no drill, or was the last one."""
        return not self._records or self.number == self._count

    def following(self) -> Attempt:
        """Return the next attempt."""
        attempt = Attempt(self._test, self._seed, self._count, self._first or self)
        attempt.number = self.number + 1
        return attempt

    def take(self, drill: LockstepDrill) -> None:
        """Disturb a drill that the test has taken, unless this is the first run."""
        self._taken += 1
        seed = f"{self._seed} {self._test} {self.number} {self._taken}"
        drill.disturb(seed if self._first else None)

    def finish(self, drills: Sequence[LockstepDrill]) -> None:
        """Keep what the drills' nodes have done, and compare it with the first run."""
        self._records = [drill.record_attempt() for drill in drills]
        if self._first is not None:
            self.difference = "\n".join(self._differences(self._first._records))

    def fail(self) -> None:
        """Fail a test that has passed and differs from its first run."""
        if self.difference:
            self.named = True
            pytest.fail(self.text, pytrace=False)

    def _differences(self, first: Sequence[DrillRecord]) -> list[str]:
        from rpud_sim.testing.attempt_records import first_difference, verdict_differences

        lines, verdicts = [], []
        for number, (there, before) in enumerate(zip(self._records, first, strict=False), 1):
            drill = f"drill {number}: " if len(first) > 1 else ""
            if found := first_difference(before, there):
                lines.append(f"{drill}the first difference is {found}")
                lines += circumstances(there, found)
            verdicts += verdict_differences(before.verdicts, there.verdicts)
        if len(self._records) != len(first):
            lines.append(f"{len(self._records)} drills, in the first run {len(first)}")
        return [*lines, *verdicts]


def circumstances(there: DrillRecord, difference: Difference) -> list[str]:
    """Return what disturbed the step of a difference, or the latest one before it, as lines."""
    from rpud_sim.ros.drill.drawn_order import ShuffledOrder

    steps = _steps_of_part(there, difference.part)
    until = next((each.until for each in steps if each.until >= difference.stamp), math.inf)
    for step in reversed([each for each in steps if each.until <= until]):
        lines = list(map(str, step.stops))
        order = ShuffledOrder(step.shuffle, there.rate)
        topics = order.order(min(step.until, difference.stamp), there.subscribed)
        if step.shuffle and len(topics) > 1:
            published = f"the drill published {', then '.join(topics)}"
            lines.append(f"{published}; in the first run by their times")
        if lines:
            earlier = "" if step.until == until else "the latest disturbance was "
            return [f"{earlier}in the step to {step.until / SECOND:.3f} s {line}" for line in lines]
    return ["no node was disturbed before: it differs by itself"]


def _steps_of_part(there: DrillRecord, part: int) -> list[Any]:
    """Return the steps between two resets, at which time goes back."""
    parts: list[list[Any]] = [[]]
    for step in there.steps:
        if parts[-1] and step.until <= parts[-1][-1].until:
            parts.append([])
        parts[-1].append(step)
    return parts[min(part, len(parts) - 1)]


def shake(item: pytest.Item, nextitem: pytest.Item | None, count: int, seed: int) -> None:
    """Run a test with its shaken runs, and report it as one test."""
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for report in _attempted(item, nextitem, Attempt(item.nodeid, seed, count)):
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)


def _attempted(
    item: pytest.Item, nextitem: pytest.Item | None, attempt: Attempt
) -> list[pytest.TestReport]:
    """Return the reports of the first run, or of a shaken one that fails."""
    properties = list(item.user_properties)
    first = reports = _reports(item, nextitem, attempt)
    while all(map(_passed, reports)) and not (attempt.last or _stops(item)):
        attempt = attempt.following()
        item.user_properties[:] = properties
        item._report_sections.clear()
        reports = _reports(item, nextitem, attempt)
    failed = attempt.number > 0 and any(report.failed for report in reports)
    if not failed:
        return first
    for report in reports:
        if report.failed and not attempt.named:
            _add(report, attempt.text)
    return reports


def _reports(
    item: pytest.Item, nextitem: pytest.Item | None, attempt: Attempt
) -> list[pytest.TestReport]:
    """Run an attempt, as pytest runs a test; fixtures of the module stay until the last attempt."""
    function: Any = item
    if getattr(function, "_request", None) is False:  # it is run again
        function._initrequest()
    item.stash[ATTEMPT] = attempt
    reports = [call_and_report(item, "setup", log=False)]
    if reports[0].passed:
        reports.append(call_and_report(item, "call", log=False))
    more = all(map(_passed, reports)) and not (attempt.last or _stops(item))
    following: Any = item.parent if more else None if _stops(item) else nextitem
    reports.append(call_and_report(item, "teardown", log=False, nextitem=following))
    if more and not _passed(reports[-1]):
        reports += _torn_down(item, nextitem)
    if hasattr(function, "_request"):
        function._request = False
        function.funcargs = None
    return reports


def _torn_down(item: pytest.Item, nextitem: pytest.Item | None) -> list[pytest.TestReport]:
    """Tear down the module after an attempt that should not have been the last one."""
    call = pytest.CallInfo.from_call(
        lambda: item.session._setupstate.teardown_exact(nextitem), when="teardown"
    )
    if call.excinfo is None:
        return []
    return [item.ihook.pytest_runtest_makereport(item=item, call=call)]


def _passed(report: pytest.TestReport) -> bool:
    return report.passed and not hasattr(report, "wasxfail")


def _stops(item: pytest.Item) -> bool:
    return bool(item.session.shouldfail or item.session.shouldstop)


def _add(report: pytest.TestReport, text: str) -> None:
    """Add a text to a failure, and its first line to the summary."""
    found: Any = report.longrepr
    if hasattr(found, "addsection"):
        found.addsection("rpud_sim shake", text)
    else:
        report.longrepr = f"{text}\n{found}"
    place = getattr(found, "reprcrash", None)
    if place is not None:
        place.message = f"{text.splitlines()[0]}: {place.message}"
