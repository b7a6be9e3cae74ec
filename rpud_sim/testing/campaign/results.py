"""Results of a campaign: each requirement under each scenario."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from rpud_sim.testing.campaign.outcome import SYSTEM, Outcome
from rpud_sim.testing.campaign.specification import Campaign, PlannedRun, Scenario
from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, OUTCOMES, PASSED, UNDECIDED


@dataclasses.dataclass(frozen=True)
class FlownRun:
    """Run of a campaign with its outcome."""

    run: PlannedRun  # as planned
    outcome: Outcome  # of the run
    folder: str  # of the run, relative to that of the campaign

    @property
    def bag(self) -> str:
        """Path of its bag, relative to the campaign's folder; empty for none."""
        return f"{self.folder}/{self.outcome.bag}" if self.outcome.bag else ""


@dataclasses.dataclass(frozen=True)
class Cell:
    """Verdicts on one requirement in some runs."""

    counts: Mapping[str, int]  # of each outcome
    margin: float | None  # the least one; None without any
    unit: str  # of the margin
    reaction_time: float | None  # the longest one [s]; None without any
    worst: FlownRun  # run that shows the worst verdict
    verdict: Verdict  # that verdict

    @property
    def outcome(self) -> str:
        """Failed if one failed, passed if one passed, undecided otherwise."""
        return next((each for each in (FAILED, PASSED) if self.counts[each]), UNDECIDED)


@dataclasses.dataclass(frozen=True)
class Requirement:
    """Requirement with its cells."""

    identifier: str  # of the requirement; the expectation's name where it has none
    text: str  # of the requirement; empty if the campaign gives none
    expectations: tuple[str, ...]  # names of its expectations
    cells: Mapping[str, Cell]  # by the name of the scenario; none without an expectation
    whole: Cell | None  # of all runs; None without an expectation

    @property
    def outcome(self) -> str:
        """Its outcome over all runs."""
        return UNDECIDED if self.whole is None else self.whole.outcome


@dataclasses.dataclass(frozen=True)
class Results:
    """Results of a campaign."""

    campaign: Campaign  # that was flown
    runs: tuple[FlownRun, ...]  # all of them, in order
    # the system under test itself first, then as the campaign has them
    requirements: tuple[Requirement, ...]

    @property
    def passed(self) -> bool:
        """Whether each requirement passed: it failed in no run, and passed in one at least."""
        return all(requirement.outcome == PASSED for requirement in self.requirements)

    @property
    def counts(self) -> dict[str, int]:
        """Number of requirements by outcome."""
        return {
            outcome: sum(each.outcome == outcome for each in self.requirements)
            for outcome in OUTCOMES
        }

    @property
    def digest(self) -> str:
        """Digest of the results of all runs; no wall time is in it."""
        lines = [f"{each.run.name} {each.outcome.digest}\n" for each in self.runs]
        return hashlib.sha256("".join(lines).encode()).hexdigest()

    @property
    def digests(self) -> dict[str, list[str]]:
        """Digests of each run: more than one where its repetitions have different results."""
        found: dict[str, dict[str, None]] = {}
        for each in self.runs:
            found.setdefault(each.run.what, {})[each.outcome.digest] = None
        return {name: list(digests) for name, digests in found.items()}

    @property
    def repeatable(self) -> bool:
        """Whether all repetitions of each run have the same results."""
        return all(len(digests) == 1 for digests in self.digests.values())

    def to_dict(self) -> dict[str, Any]:
        """Return the content for JSON."""
        return {
            "campaign": self.campaign.name,
            "passed": self.passed,
            "repeatable": self.repeatable,
            "counts": self.counts,
            "digest": self.digest,
            "requirements": [_requirement_to_dict(each) for each in self.requirements],
            "runs": [_run_to_dict(each) for each in self.runs],
        }


def results_of(campaign: Campaign, runs: Sequence[FlownRun]) -> Results:
    """Return the results of a campaign, whose runs have all ended."""
    names: dict[str, list[str]] = {SYSTEM: [SYSTEM], **{key: [] for key in campaign.requirements}}
    for expectation in campaign.expectations:
        identifier = expectation.requirement or expectation.name
        names.setdefault(identifier, []).append(expectation.name)
    requirements = []
    for identifier, expectations in names.items():
        cells = {
            scenario.name: cell
            for scenario in campaign.scenarios
            if (cell := _cell(runs, expectations, scenario)) is not None
        }
        requirements.append(
            Requirement(
                identifier,
                campaign.requirements.get(identifier, ""),
                tuple(expectations),
                cells,
                _cell(runs, expectations),
            )
        )
    return Results(campaign, tuple(runs), tuple(requirements))


def _cell(
    runs: Sequence[FlownRun], names: Sequence[str], scenario: Scenario | None = None
) -> Cell | None:
    found = [
        (verdict, run)
        for run in runs
        if scenario is None or run.run.scenario.name == scenario.name
        for verdict in run.outcome.verdicts
        if verdict.name in names
    ]
    if not found:
        return None
    units = {verdict.unit for verdict, _ in found if verdict.margin is not None}
    margins = [verdict.margin for verdict, _ in found if verdict.margin is not None]
    reactions = [v.reaction_time for v, _ in found if v.reaction_time is not None]
    worst = min(found, key=_badness)
    return Cell(
        {outcome: sum(v.outcome == outcome for v, _ in found) for outcome in OUTCOMES},
        min(margins) if len(units) == 1 else None,  # margins in two units have no least
        units.pop() if len(units) == 1 else "",
        max(reactions, default=None),
        worst[1],
        worst[0],
    )


def _badness(entry: tuple[Verdict, FlownRun]) -> tuple[int, float]:
    verdict = entry[0]
    margin = float("inf") if verdict.margin is None else verdict.margin
    return (FAILED, UNDECIDED, PASSED).index(verdict.outcome), margin


def _requirement_to_dict(requirement: Requirement) -> dict[str, Any]:
    return {
        "requirement": requirement.identifier,
        "text": requirement.text,
        "expectations": list(requirement.expectations),
        "outcome": requirement.outcome,
        "scenarios": {name: _cell_to_dict(cell) for name, cell in requirement.cells.items()},
    }


def _cell_to_dict(cell: Cell) -> dict[str, Any]:
    return {
        "outcome": cell.outcome,
        **cell.counts,
        "margin": cell.margin,
        "unit": cell.unit,
        "reaction_time": cell.reaction_time,
        "worst_run": cell.worst.run.name,
        "bag": cell.worst.bag,
    }


def _run_to_dict(flown: FlownRun) -> dict[str, Any]:
    run = flown.run
    return {
        "run": run.name,
        "scenario": run.scenario.name,
        "faults": list(run.scenario.faults),
        "parameters": dict(run.parameters),
        "seed": run.setup.seed,
        **flown.outcome.to_dict(),
        "bag": flown.bag,
    }
