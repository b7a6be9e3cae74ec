"""Campaign: its system under test, its scenarios, and the plan of all its runs."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, shown
from rpud_sim.testing.setup import DrillSetup
from rpud_sim.verdicts import Expectation

_UNSAFE = re.compile(r"[^\w.=+-]+")
_LONGEST_SLUG = 80
_MOST_NAMES = 5  # in an error


class CampaignError(ParameterError):
    """Unusable campaign; the text says why, in one line.

    Args:
        path: keys and numbers that lead to the place in the file's content.
    """

    def __init__(self, reason: object, path: tuple[str | int, ...] = ()) -> None:
        super().__init__(str(reason))
        self.path = path


@dataclasses.dataclass(frozen=True)
class System:
    """System under test."""

    command: tuple[str, ...]  # words
    folder: Path  # in which it starts
    answers: tuple[str, ...]  # topics on which it answers each step
    hears: tuple[str, ...]  # topics of the drill that it subscribes to
    ready: str  # regular expression that its output has when it is ready; empty for none
    period: float  # simulation time between two answers [s]
    answer_timeout: float  # longest real time for the answers to one step [s]
    start_timeout: float  # longest real time until it is ready [s]
    run_timeout: float  # longest real time of a whole run [s]
    files: Mapping[str, str]  # digest of each of its files that the campaign names
    name: str = ""  # for messages; the command's file if empty


@dataclasses.dataclass(frozen=True)
class Scenario:
    """What happens in a run."""

    name: str  # of the scenario
    faults: tuple[str, ...]  # phrase for each fault that it has
    duration: float  # of simulation time [s]


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """One run of a campaign."""

    number: int  # of the run in its campaign, from 1 on
    scenario: Scenario  # of the run
    parameters: Mapping[str, Any]  # values of the parameters that the campaign varies
    setup: DrillSetup  # of the drill
    repetition: int = 1  # number of this repetition of the same run, from 1 on

    @property
    def what(self) -> str:
        """Name of the run, which its repetitions share."""
        values = [f"{name}={value}" for name, value in self.parameters.items()]
        return " ".join([self.scenario.name, *values, f"seed={self.setup.seed}"])

    @property
    def name(self) -> str:
        """Name of the run, which is unique in its campaign."""
        return self.what if self.repetition == 1 else f"{self.what} repetition={self.repetition}"

    @property
    def folder(self) -> str:
        """Name of the run's folder."""
        slug = _UNSAFE.sub("_", self.what)[:_LONGEST_SLUG]
        repetition = "" if self.repetition == 1 else f"_{self.repetition:04}"
        return f"{self.number:04}_{slug}{repetition}"


@dataclasses.dataclass(frozen=True)
class Campaign:
    """Campaign as its file describes it, wholly checked."""

    name: str  # of the campaign
    requirements: Mapping[str, str]  # text of each requirement by its identifier; may be empty
    system: System  # under test
    runs: tuple[PlannedRun, ...]  # all of them, in order
    expectations: tuple[Expectation, ...]  # on each run

    @property
    def scenarios(self) -> tuple[Scenario, ...]:
        """The scenarios, in the order of the file."""
        return tuple({run.scenario.name: run.scenario for run in self.runs}.values())

    def only(self, pattern: re.Pattern[str]) -> Campaign:
        """Return the campaign with those runs alone in whose names a pattern is found.

        Raises:
            CampaignError: if there is none.
        """
        runs = tuple(run for run in self.runs if pattern.search(run.name))
        if not runs:
            names = ", ".join(run.name for run in self.runs[:_MOST_NAMES])
            raise CampaignError(f"no run matches {shown(pattern.pattern)}; the first are {names}")
        return dataclasses.replace(self, runs=runs)

    def repeated(self, count: int) -> Campaign:
        """Return the campaign with each run several times, to compare their results."""
        runs = (
            dataclasses.replace(run, repetition=repetition)
            for run in self.runs
            for repetition in range(1, count + 1)
        )
        return dataclasses.replace(self, runs=tuple(runs))


def combinations(parameters: Mapping[str, list[Any]]) -> list[dict[str, Any]]:
    """Return every combination of the values of some parameters; one without any, for none."""
    return [
        dict(zip(parameters, values, strict=True))
        for values in itertools.product(*parameters.values())
    ]
