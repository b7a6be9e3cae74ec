"""Results of a campaign: each requirement under each scenario."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from rpud_sim.testing.campaign.campaign_file import read_campaign
from rpud_sim.testing.campaign.outcome import SYSTEM, RunOutcome, outcome_from_json
from rpud_sim.testing.campaign.specification import (
    CampaignRun,
    CampaignScenario,
    CampaignSpecification,
)
from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, OUTCOMES, PASSED, UNDECIDED


@dataclasses.dataclass(frozen=True)
class FlownRun:
    """Run of a campaign with its outcome."""

    run: CampaignRun
    outcome: RunOutcome
    wall_time: float = 0.0  # that it took [s]
    bag: str = ""  # path of its bag, relative to the page; empty for none
    report: str = ""  # path of its report page, likewise

    def to_dict(self) -> dict[str, Any]:
        """Return the content for JSON."""
        return {
            "run": self.run.name,
            "scenario": self.run.scenario.name,
            "faults": list(self.run.scenario.faults),
            "parameters": dict(self.run.parameters),
            "seed": self.run.setup.seed,
            "wall_time": self.wall_time,
            "bag": self.bag,
            "report": self.report,
            **dataclasses.asdict(self.outcome),
        }


@dataclasses.dataclass(frozen=True)
class MatrixCell:
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

    def __str__(self) -> str:
        margin = "" if self.margin is None else f" {self.margin:.3g} {self.unit}".rstrip()
        reaction = "" if self.reaction_time is None else f" in {self.reaction_time:.2f} s"
        return f"{self.outcome}{margin}{reaction}"


@dataclasses.dataclass(frozen=True)
class Requirement:
    """Requirement with its cells."""

    identifier: str  # the expectation's name where it has none
    text: str  # empty if the campaign gives none
    expectations: tuple[str, ...]  # names
    cells: Mapping[str, MatrixCell]  # by the name of the scenario; none without an expectation
    whole: MatrixCell | None  # of all runs; None without an expectation

    @property
    def outcome(self) -> str:
        """Its outcome over all runs."""
        return UNDECIDED if self.whole is None else self.whole.outcome


@dataclasses.dataclass(frozen=True)
class CampaignResults:
    """Results of those runs of a campaign that were flown."""

    campaign: CampaignSpecification
    runs: tuple[FlownRun, ...]  # in the order of the campaign
    # the system under test itself first, then as the campaign has them
    requirements: tuple[Requirement, ...]

    @property
    def scenarios(self) -> tuple[CampaignScenario, ...]:
        """The scenarios that were flown."""
        return tuple({each.run.scenario.name: each.run.scenario for each in self.runs}.values())

    @property
    def counts(self) -> dict[str, int]:
        """Number of requirements by outcome."""
        outcomes = [each.outcome for each in self.requirements]
        return {outcome: outcomes.count(outcome) for outcome in OUTCOMES}

    @property
    def undecided(self) -> dict[str, str]:
        """Requirements that no run decides, with the reason of one verdict."""
        return {
            each.identifier: each.whole.verdict.text if each.whole else "no run has a verdict on it"
            for each in self.requirements
            if each.outcome == UNDECIDED
        }

    def lines(self) -> list[str]:
        """Return the matrix of requirements by scenarios as lines of a table."""
        names = [scenario.name for scenario in self.scenarios]
        rows = [["requirement", "verdict", *names]]
        for each in self.requirements:
            cells = [str(each.cells.get(name, "-")) for name in names]
            rows.append([each.identifier, each.outcome, *cells])
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        counts = ", ".join(f"{count} {outcome}" for outcome, count in self.counts.items())
        return [
            *("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows),
            "",
            f"requirements: {counts}",
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the content for JSON."""
        return {
            "campaign": self.campaign.name,
            "counts": self.counts,
            "requirements": {each.identifier: each.outcome for each in self.requirements},
            "runs": [each.to_dict() for each in self.runs],
        }


def results_from_reports(
    file: Path, reports: Collection[Mapping[str, Any]], place: Path
) -> CampaignResults:
    """Return the results of a campaign.

    Args:
        reports: what pytest has reported of its runs.
        place: folder of the page, to which paths are relative.
    """
    campaign = read_campaign(file)
    found = {report["name"]: report for report in reports}
    runs = []
    for run in campaign.runs:
        if report := found.get(run.name):
            files = (report.get(name, "") for name in ("rpud_bag", "rpud_report"))
            relative = [file and Path(file).relative_to(place).as_posix() for file in files]
            outcome = outcome_from_json(report["outcome"])
            runs.append(FlownRun(run, outcome, report["wall_time"], *relative))
    return results_of(campaign, runs)


def results_of(campaign: CampaignSpecification, runs: Sequence[FlownRun]) -> CampaignResults:
    """Return the results of those runs of a campaign that were flown."""
    names: dict[str, list[str]] = {SYSTEM: [SYSTEM], **{key: [] for key in campaign.requirements}}
    for expectation in campaign.expectations:
        identifier = expectation.requirement or expectation.name
        names.setdefault(identifier, []).append(expectation.name)
    requirements = []
    for identifier, expectations in names.items():
        cells = {}
        for scenario in dict.fromkeys(each.run.scenario.name for each in runs):
            own = [each for each in runs if each.run.scenario.name == scenario]
            cell = _cell(own, expectations)
            if cell is not None:
                cells[scenario] = cell
        text = campaign.requirements.get(identifier, "")
        whole = _cell(runs, expectations)
        requirements.append(Requirement(identifier, text, tuple(expectations), cells, whole))
    return CampaignResults(campaign, tuple(runs), tuple(requirements))


def _cell(runs: Sequence[FlownRun], names: Sequence[str]) -> MatrixCell | None:
    found = [
        (verdict, run) for run in runs for verdict in run.outcome.verdicts if verdict.name in names
    ]
    if not found:
        return None
    units = {verdict.unit for verdict, _ in found if verdict.margin is not None}
    margins = [verdict.margin for verdict, _ in found if verdict.margin is not None]
    reactions = [v.reaction_time for v, _ in found if v.reaction_time is not None]
    verdict, run = min(found, key=_badness)
    return MatrixCell(
        {outcome: sum(v.outcome == outcome for v, _ in found) for outcome in OUTCOMES},
        min(margins) if len(units) == 1 else None,  # margins in two units have no least
        units.pop() if len(units) == 1 else "",
        max(reactions, default=None),
        run,
        verdict,
    )


def _badness(entry: tuple[Verdict, FlownRun]) -> tuple[int, float]:
    verdict = entry[0]
    margin = float("inf") if verdict.margin is None else verdict.margin
    return (FAILED, UNDECIDED, PASSED).index(verdict.outcome), margin
