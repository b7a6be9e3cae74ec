"""Outcome of a run: how it ended, and the verdicts on it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

COMPLETED = "completed"
BROKEN = "broken"
ENDINGS: Mapping[str, str] = {
    COMPLETED: "the system under test has answered every step",
    "died": "the system under test ended by itself",
    "silent": "the system under test does not answer",
    "late": "the system under test answers too late",
    BROKEN: "the drill or the middleware failed: the run says nothing about the system under test",
}
SYSTEM = "system under test"
"""Name of the verdict that every run has: whether the system under test has answered to the end."""

_LAST_LINES = 20


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a run came to."""

    of: str  # digest of what was run
    ending: str  # one of ``ENDINGS``
    reached: float  # simulation time at its end [s]
    text: str  # why it ended early, with the last lines of output; empty if it is completed
    verdicts: tuple[Verdict, ...]  # on the system under test, and on each expectation
    record: str  # digest of what was published and commanded
    wall_time: float  # that it took [s]
    bag: str  # path of its bag in its folder; empty for none
    # reasons of earlier flights, in which the drill or the middleware failed
    broken: tuple[str, ...] = ()

    @property
    def digest(self) -> str:
        """Digest of all results; no wall time and no output of a program is in it."""
        content = [
            self.ending,
            self.reached,
            self.record,
            [_plain(verdict) for verdict in self.verdicts],
        ]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def to_dict(self) -> dict[str, Any]:
        """Return the content for JSON."""
        return {
            **dataclasses.asdict(self),
            "verdicts": [verdict.to_dict() for verdict in self.verdicts],
            "digest": self.digest,
        }


def outcome_from_dict(content: Mapping[str, Any]) -> Outcome:
    """Return the outcome that ``to_dict`` gave.

    Raises:
        KeyError: if it is of another version.
        TypeError: likewise.
    """
    names = [field.name for field in dataclasses.fields(Verdict)]
    verdicts = tuple(
        Verdict(**{name: each[name] for name in names}) for each in content["verdicts"]
    )
    own = {field.name for field in dataclasses.fields(Outcome)} - {"verdicts", "broken"}
    fields = {name: content[name] for name in own}
    return Outcome(**fields, verdicts=verdicts, broken=tuple(content["broken"]))


def system_verdict(ending: str, reached: float, text: str) -> Verdict:
    """Return the verdict on the system under test itself."""
    outcome = {COMPLETED: PASSED, BROKEN: UNDECIDED}.get(ending, FAILED)
    reason = text.partition("\n")[0] or ENDINGS[ending]
    return Verdict(SYSTEM, "", outcome, None, "", reached, None, reason)


def last_lines(text: str) -> str:
    """Return the beginning and the last lines of a long text."""
    lines = text.splitlines()
    if len(lines) <= _LAST_LINES:
        return text
    return "\n".join([lines[0], "    ...", *lines[-_LAST_LINES:]])


def _plain(verdict: Verdict) -> dict[str, Any]:
    content = verdict.to_dict()
    if verdict.name == SYSTEM:
        del content["text"]  # it may have the number of a process
    return content
