"""Rows of a report's tables of segments and of the energy account."""

from __future__ import annotations

import math

from rpud_sim.inspection.report.drill_topics import Powers
from rpud_sim.inspection.report.periods import Periods
from rpud_sim.inspection.report.power_flow import terms
from rpud_sim.inspection.report.rows import Rows, show
from rpud_sim.pages.words import number

PERIOD_HEADING = (
    "begin [s]", "end [s]", "commands in force", "active faults", "impacts", "impact rate [1/s]",
    "peak force: mean [N]", "median [N]", "95 % [N]", "greatest [N]", "reacting force: mean [N]",
    "energy of impacts [J]", "power of impacts [W]",
)  # fmt: skip
ACCOUNT_HEADING = ("term", "energy [J]", "mean power [W]", "share of what comes in [%]")


def period_rows(periods: Periods) -> Rows:
    """Return the statistics of each segment between commands and faults."""
    return [
        (
            f"{period.begin:.6f}",
            f"{period.end:.6f}",
            period.commands or "not known",
            period.faults or "none",
            str(period.impacts),
            _short(period.impact_rate),
            _short(period.peak_force.mean),
            _short(period.peak_force.quantile(0.5)),
            _short(period.peak_force.quantile(0.95)),
            _short(period.peak_force.greatest),
            _short(period.reacting_force.mean),
            _short(period.energy),
            _short(period.power),
        )
        for period in periods.all
        if period.duration > 0.0 or period.impacts
    ]


def account_rows(powers: Powers, electrical: float) -> Rows:
    """Return the terms of the energy account: in, out, and what is left.

    ``electrical`` is the mean power that the actuator draws [W]; NaN where it is not modelled.
    """
    means = powers.means()
    if not means:
        return []
    into, out = terms(means)
    came, went = sum(into.values()), sum(out.values())

    def row(text: str, power: float) -> tuple[str, ...]:
        share = 100.0 * power / came if came else math.nan
        return text, show(power * powers.seconds), show(power), show(share)

    return [
        *(row(f"in: {text}", power) for text, power in into.items()),
        row("in, together", came),
        *(row(f"out: {text}", power) for text, power in out.items()),
        row("out, together", went),
        row("residual: in − out", came - went),
        *(
            (row("electrical, drawn by the actuator", electrical),)
            if math.isfinite(electrical)
            else ()
        ),
    ]


def _short(value: float) -> str:
    return number(value) if math.isfinite(value) else show(None)
