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
        reason: one line.
        path: keys and numbers that lead to the place in the file's content.
    """

    def __init__(self, reason: object, path: tuple[str | int, ...] = ()) -> None:
        super().__init__(str(reason))
        self.path = path


@dataclasses.dataclass(frozen=True)
class System:
    """System under test.

    Args:
        command: words.
        folder: in which it starts.
        answers: topics on which it answers each step.
        hears: topics of the drill that it subscribes to.
        ready: regular expression that its output has when it is ready; empty for none.
        period: simulation time between two answers [s].
        answer_timeout: longest real time for the answers to one step [s].
        start_timeout: longest real time until it is ready [s].
        run_timeout: longest real time of a whole run [s].
        files: digest of each of its files that the campaign names.
        name: for messages; the command's file if empty.
    """

    command: tuple[str, ...]
    folder: Path
    answers: tuple[str, ...]
    hears: tuple[str, ...]
    ready: str
    period: float
    answer_timeout: float
    start_timeout: float
    run_timeout: float
    files: Mapping[str, str]
    name: str = ""


@dataclasses.dataclass(frozen=True)
class Scenario:
    """What happens in a run.

    Args:
        name: of the scenario.
        faults: phrase for each fault that it has.
        duration: of simulation time [s].
    """

    name: str
    faults: tuple[str, ...]
    duration: float


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """One run of a campaign.

    Args:
        number: of the run in its campaign, from 1 on.
        scenario: of the run.
        parameters: values of the parameters that the campaign varies.
        setup: of the drill.
        repetition: number of this repetition of the same run, from 1 on.
    """

    number: int
    scenario: Scenario
    parameters: Mapping[str, Any]
    setup: DrillSetup
    repetition: int = 1

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
    """Campaign as its file describes it, wholly checked.

    Args:
        name: of the campaign.
        requirements: text of each requirement by its identifier; may be empty.
        system: under test.
        runs: all of them, in order.
        expectations: on each run.
    """

    name: str
    requirements: Mapping[str, str]
    system: System
    runs: tuple[PlannedRun, ...]
    expectations: tuple[Expectation, ...]

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
