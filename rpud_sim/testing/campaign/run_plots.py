"""Plots of a campaign over its runs: margins, times to react, and durations."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rpud_sim.pages.plot import Axis, Layer, Plot, Points, Rule
from rpud_sim.testing.campaign.outcome import SYSTEM
from rpud_sim.testing.campaign.results import FlownRun, Results
from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, PASSED

_COLORS = {PASSED: "series2", FAILED: "fault"}
_MARKERS = {PASSED: "circle", FAILED: "x"}
_RUN = Axis("run")


def margin_plots(results: Results) -> tuple[Plot, ...]:
    """Return the margin of each expectation over the runs; an expectation without any has none."""
    found = []
    for name in _expectations(results):
        numbers, verdicts = _verdicts(results.runs, name, lambda verdict: verdict.margin)
        if not verdicts:
            continue
        worst = min(range(len(verdicts)), key=lambda i: _margin(verdicts[i]))
        unit = verdicts[worst].unit
        alt = (
            f"Least: {_margin(verdicts[worst]):.4g} {unit}".rstrip() + f" in run {numbers[worst]}."
        )
        limit = Rule("limit", 0.0, color="muted")
        layers = (limit, *_layers(numbers, verdicts, _margin))
        found.append(Plot(f"margin: {name}", layers, alt, Axis(unit=unit), _RUN))
    return tuple(found)


def reaction_plots(results: Results) -> tuple[Plot, ...]:
    """Return the time to react of each expectation that has one, over the runs."""
    found = []
    for name in _expectations(results):
        numbers, verdicts = _verdicts(results.runs, name, lambda verdict: verdict.reaction_time)
        if verdicts:
            longest = max(range(len(verdicts)), key=lambda i: _reaction(verdicts[i]))
            alt = f"Longest: {_reaction(verdicts[longest]):.3f} s in run {numbers[longest]}."
            layers = _layers(numbers, verdicts, _reaction)
            up = Axis(unit="s", low=0.0)
            found.append(Plot(f"time to react: {name}", layers, alt, up, _RUN))
    return tuple(found)


def duration_plots(results: Results) -> tuple[Plot, ...]:
    """Return simulated and real durations over the runs."""
    numbers = np.arange(1.0, len(results.runs) + 1.0)
    found = []
    for title, times in (
        ("simulated time", [flown.outcome.reached for flown in results.runs]),
        ("real time", [flown.outcome.wall_time for flown in results.runs]),
    ):
        alt = f"{min(times):.3g} to {max(times):.3g} s, together {sum(times):.4g} s."
        points = Points(title, numbers, np.array(times))
        found.append(Plot(title, (points,), alt, Axis(unit="s", low=0.0), _RUN))
    return tuple(found)


def _expectations(results: Results) -> list[str]:
    names = (
        verdict.name
        for flown in results.runs
        for verdict in flown.outcome.verdicts
        if verdict.name != SYSTEM
    )
    return list(dict.fromkeys(names))


def _verdicts(
    runs: Sequence[FlownRun], name: str, value: Callable[[Verdict], float | None]
) -> tuple[list[int], list[Verdict]]:
    """Return places of runs, from 1 on, and their verdicts on one expectation that have a value."""
    pairs = [
        (number, verdict)
        for number, flown in enumerate(runs, 1)
        for verdict in flown.outcome.verdicts
        if verdict.name == name and value(verdict) is not None
    ]
    return [number for number, _ in pairs], [verdict for _, verdict in pairs]


def _layers(
    numbers: Sequence[int], verdicts: Sequence[Verdict], value: Callable[[Verdict], float]
) -> tuple[Layer, ...]:
    layers = []
    for outcome, color in _COLORS.items():
        chosen = [i for i, verdict in enumerate(verdicts) if verdict.outcome == outcome]
        if chosen:
            x = np.array([numbers[i] for i in chosen], float)
            y = np.array([value(verdicts[i]) for i in chosen])
            marker = _MARKERS[outcome]
            layers.append(Points(outcome, x, y, marker=marker, size=7.0, color=color))
    return tuple(layers)


def _margin(verdict: Verdict) -> float:
    return float("nan") if verdict.margin is None else verdict.margin


def _reaction(verdict: Verdict) -> float:
    return float("nan") if verdict.reaction_time is None else verdict.reaction_time
