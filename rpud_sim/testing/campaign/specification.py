"""Campaign as its file describes it: the system under test, the scenarios and all runs."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.testing.setup import DrillSetup
from rpud_sim.verdicts import Expectation


class CampaignError(ParameterError):
    """Unusable campaign; the text gives the reason in one line.

    Args:
        path: keys and numbers that lead to the place in the file's content.
    """

    def __init__(self, reason: object, path: tuple[str | int, ...] = ()) -> None:
        super().__init__(str(reason))
        self.path = path


@dataclasses.dataclass(frozen=True)
class CampaignSystem:
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
    name: str = ""  # for messages; the command's file if empty

    @property
    def command_line(self) -> str:
        """The command for people."""
        return shlex.join("python" if word == sys.executable else word for word in self.command)


@dataclasses.dataclass(frozen=True)
class CampaignScenario:
    """Faults of some runs, and their duration."""

    name: str
    faults: tuple[str, ...]  # phrase for each fault
    duration: float  # of simulation time [s]


@dataclasses.dataclass(frozen=True)
class CampaignRun:
    """One run of a campaign."""

    scenario: CampaignScenario
    parameters: Mapping[str, Any]  # values of the parameters that the campaign varies
    setup: DrillSetup  # of the drill

    @property
    def name(self) -> str:
        """Name of the run, which is unique in its campaign."""
        values = [f"{name}={value}" for name, value in self.parameters.items()]
        return " ".join([self.scenario.name, *values, f"seed={self.setup.seed}"])


@dataclasses.dataclass(frozen=True)
class CampaignSpecification:
    """Campaign, checked as a whole."""

    name: str
    requirements: Mapping[str, str]  # text of each requirement by its identifier; may be empty
    system: CampaignSystem
    runs: tuple[CampaignRun, ...]  # all of them, in order
    expectations: tuple[Expectation, ...]  # on each run
