"""Result of a fit, and its files: numbers, posterior, parameter file, and a page."""

from __future__ import annotations

import dataclasses
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from rpud_sim.foundation.json_text import finite_values, json_text
from rpud_sim.foundation.shown_quantities import ShownQuantity, quantity_in
from rpud_sim.foundation.whole_folder import write_whole
from rpud_sim.pages.frame import Picture, colors, picture, render_page
from rpud_sim.simulation.configuration import to_configuration, to_values
from rpud_sim.simulation.versions import engine_versions, version_of
from rpud_sim.studies.fit.posterior import LEVEL, PERCENT, Interval, Ridge
from rpud_sim.studies.fit.target_file import FitSpecification, FitTarget
from rpud_sim.studies.sweep.specification import unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BEST_RUNS = 64  # at the best point
_FAR = 3.0  # deviation from which on the model does not reach a target
_BINS = 40
_TAIL = 0.002  # share of the posterior beyond each end of what is shown

_BODY = """\
{% set used = fit.comparisons | rejectattr("target.hold_out") | list | length %}
<p class="verdict">
{% if fit.missed %}
Not met: {{ fit.refusal }}.
{% else %}
The model reaches all {{ used }} targets that the fit used.
{% endif %}
Root mean square of the deviations: {{ fit.misfit_text }}.</p>
{% if fit.refusal %}
<p class="warning">There are no intervals: {{ fit.refusal }}.</p>
{% endif %}
{% for item in fit.missed %}
<p class="warning">{{ item.miss }}</p>
{% endfor %}
{% if singles %}
<h2>Posterior of the unknown parameters</h2>
<p class="none">The line is the best point, the band the {{ percent }} interval.</p>
{{ figures(singles) }}
{% endif %}
{% if fit.ridges %}
<p class="warning">The targets determine these pairs only together:
{{ fit.ridges | join("; ") }}.</p>
{% endif %}
{{ table(*unknowns, caption="Unknown parameters") }}
{% if fit.choices %}
{{ table(("choices", "probability"), fit.choices, caption="Choices") }}
{% endif %}
{{ table(*targets, caption="Targets") }}
<details><summary>How to read it</summary>
<p>Made by <code>{{ command }}</code>. Seed {{ fit.specification.seed }},
{{ fit.simulations + fit.kept }} runs. The model's figures are means of {{ best_runs }} runs at the
best point. All numbers are in fit.json.
{% if not fit.refusal %}
Intervals contain {{ percent }} of the fitted distribution (posterior). Before the fit all values
between the bounds were equally probable (flat prior). The plots show the range of the posterior;
the bounds may be outside. The width is the width of the interval over the distance of the bounds:
near 1, the targets do not determine the parameter.
{% endif %}</p>
</details>
"""


@dataclasses.dataclass(frozen=True)
class TargetComparison:
    """Target beside the model at the best point."""

    target: FitTarget  # of the fit
    mean: float  # of the model's runs
    standard_error: float  # of the mean
    spread: float  # standard deviation of single runs

    @property
    def ratio(self) -> float:
        return self.mean / self.target.value if self.target.value else math.nan

    @property
    def deviation(self) -> float:
        """Difference in standard deviations of tolerance, chance and the mean's own error."""
        total = math.hypot(self.target.error(self.spread), self.standard_error)
        return (self.mean - self.target.value) / total

    @property
    def reached(self) -> bool:
        """Whether the model is within three standard deviations of the target."""
        return abs(self.deviation) <= _FAR

    @property
    def miss(self) -> str:
        """By how much the model misses the target, in words."""
        difference = self.mean - self.target.value
        amount = f"{abs(difference):.4g} {self.target.measure.unit}".rstrip()
        side = "high" if difference > 0.0 else "low"
        far = f"{abs(self.deviation):.3g} standard deviations"
        return f"{self.target.title}: {amount} too {side}, {far}"

    def __str__(self) -> str:
        value = f"{self.target.value:.4g} {self.target.measure.unit}".rstrip()
        held = " (held out)" if self.target.hold_out else ""
        return f"{self.target.title}: {value}, model {self.mean:.4g}, ratio {self.ratio:.3f}{held}"


@dataclasses.dataclass(frozen=True)
class Fit:
    """Result of a fit."""

    specification: FitSpecification  # of the fit
    best: Mapping[str, Any]  # values of all unknowns at the best point, by name
    comparisons: tuple[TargetComparison, ...]  # by target
    refusal: str  # why there are no intervals; empty if there are
    shares: np.ndarray  # samples of the posterior over all choices
    intervals: Mapping[str, Interval]  # of the posterior, by unknown; none if refused
    ridges: tuple[Ridge, ...]  # pairs that the targets determine only together; none if refused
    probabilities: tuple[tuple[Mapping[str, Any], float], ...]  # of the combinations of choices
    simulations: int  # runs of this call
    kept: int  # runs of earlier calls

    @property
    def samples(self) -> Mapping[str, np.ndarray]:
        """Points of the posterior in SI units, by unknown."""
        return self.specification.values_at(self.shares)

    @property
    def missed(self) -> tuple[TargetComparison, ...]:
        """Targets that the fit used and the model does not reach."""
        used = (item for item in self.comparisons if not item.target.hold_out)
        return tuple(item for item in used if not item.reached)

    @property
    def choices(self) -> list[tuple[str, str]]:
        """Combinations of choices with their probabilities, in words; empty without choices."""
        return [
            (", ".join(f"{name} {value}" for name, value in choices.items()), f"{share:.3f}")
            for choices, share in self.probabilities
            if choices
        ]

    def misfit(self, hold_out: bool) -> float | None:
        """Return the root mean square of the deviations; None without such targets."""
        found = [c.deviation for c in self.comparisons if c.target.hold_out == hold_out]
        return float(np.sqrt(np.mean(np.square(found)))) if found else None

    @property
    def misfit_text(self) -> str:
        hold_out = self.misfit(True)
        more = "" if hold_out is None else f", held out {hold_out:.2f}"
        return f"{self.misfit(False):.2f} standard deviations{more}"


def fit_versions() -> dict[str, str]:
    """Return the versions of everything that a fit's results depend on."""
    return engine_versions() | {name: version_of(name) for name in ("scipy", "emcee")}


def write_fit(fit: Fit, folder: Path, command: str) -> None:
    """Write all files of a fit to a folder; the command makes them again."""
    write_whole(folder / "fit.json", json_text(fit_content(fit), indent=1) + "\n")
    write_whole(folder / "parameters.yaml", _parameter_file(fit, command))
    if not fit.refusal:
        text = io.StringIO()
        columns, heading = np.column_stack(list(fit.samples.values())), ",".join(fit.samples)
        np.savetxt(text, columns, fmt="%.9g", delimiter=",", header=heading, comments="")
        write_whole(folder / "posterior.csv", text.getvalue())
    page = render_page(
        _BODY,
        "Fit of a drill",
        fit=fit,
        command=command,
        singles=posterior_pictures(fit),
        unknowns=unknown_table(fit),
        targets=target_table(fit),
        best_runs=BEST_RUNS,
        percent=PERCENT,
    )
    write_whole(folder / "report.html", page)


def fit_content(fit: Fit) -> dict[str, Any]:
    content = {
        "reached": not fit.missed,
        "missed": [item.target.title for item in fit.missed],
        "refusal": fit.refusal or None,
        "best": dict(fit.best),
        "level": LEVEL,
        "unknowns": {
            name: {"best": fit.best[name], "unit": unit_of(name)}
            | (
                {**vars(interval), "identified": interval.identified}
                if (interval := fit.intervals.get(name))
                else {}
            )
            for name in fit.specification.unknowns
        },
        "choices": [
            {"choices": dict(choices), "probability": share} for choices, share in fit.probabilities
        ],
        "ridges": [
            {"parameters": list(ridge.names), "correlation": ridge.correlation}
            for ridge in fit.ridges
        ],
        "targets": [_comparison(item) for item in fit.comparisons],
        "misfit": fit.misfit(False),
        "hold_out_misfit": fit.misfit(True),
        "seed": fit.specification.seed,
        "simulations": fit.simulations + fit.kept,
        "versions": fit_versions(),
        "specification": dataclasses.asdict(fit.specification),
    }
    plain: dict[str, Any] = finite_values(content)
    return plain


def _comparison(item: TargetComparison) -> dict[str, Any]:
    return {
        "target": item.target.title,
        "source": item.target.source,
        "unit": item.target.measure.unit,
        "value": item.target.value,
        "tolerance": item.target.error(0.0),
        "hold_out": item.target.hold_out,
        "model": item.mean,
        **{
            name: getattr(item, name) for name in ("standard_error", "spread", "ratio", "deviation")
        },
        "reached": item.reached,
    }


def unknown_table(fit: Fit) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return heading and rows of the unknowns: name, best point, and what is known of it."""
    heading: tuple[str, ...] = ("parameter", "nearest point" if fit.missed else "best point")
    rows: list[tuple[str, ...]] = [
        (name, unknown_quantity(fit, name).text(fit.best[name]))
        for name in fit.specification.unknowns
    ]
    if fit.intervals:
        heading = (*heading, f"{PERCENT} interval", "width", "remarks")
        rows = [
            (*row, _ends(fit, name), f"{interval.width:.2f}", "; ".join(interval.remarks))
            for row, (name, interval) in zip(rows, fit.intervals.items(), strict=True)
        ]
    return heading, rows


def _ends(fit: Fit, name: str) -> str:
    shown, interval = unknown_quantity(fit, name), fit.intervals[name]
    return f"{shown.text(interval.low, unit=False)} to {shown.text(interval.high)}"


def unknown_quantity(fit: Fit, name: str) -> ShownQuantity:
    greatest = abs(fit.specification.unknowns[name].maximum)
    digits = fit.intervals[name].digits if name in fit.intervals else 4
    return dataclasses.replace(quantity_in(unit_of(name), greatest, name), digits=digits)


def posterior_pictures(fit: Fit) -> list[Picture]:
    """Return the posterior of every unknown that has an interval; its bounds may be outside."""
    return [_posterior_picture(fit, name, interval) for name, interval in fit.intervals.items()]


def _posterior_picture(fit: Fit, name: str, interval: Interval) -> Picture:
    shown, samples, best = unknown_quantity(fit, name), fit.samples[name], fit.best[name]
    ends = [*np.quantile(samples, [_TAIL, 1.0 - _TAIL]).tolist(), best]
    log = fit.specification.unknowns[name].scale == "log"
    edges = (np.geomspace if log else np.linspace)(min(ends), max(ends), _BINS + 1)
    shares = np.histogram(samples, edges)[0] / len(samples)

    def draw(axes: Axes) -> None:
        color, scale = colors(), shown.scale
        axes.axvspan(scale * interval.low, scale * interval.high, color=color["muted"], alpha=0.16)
        axes.stairs(shares, scale * edges, linewidth=1.4)
        axes.axvline(scale * best, color=color["series1"], linewidth=1.3)
        axes.set_ylim(bottom=0.0)

    alt = f"Best point {shown.text(best)}, {PERCENT} interval {_ends(fit, name)}."
    return picture(f"{name} [{shown.unit}]" if shown.unit else name, alt, draw)


def target_table(fit: Fit) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return heading and rows of the targets: name, value, model, ratio and deviation."""
    rows: list[tuple[str, ...]] = []
    for item in fit.comparisons:
        target = item.target
        shown = quantity_in(target.measure.unit, abs(target.value))
        name = f"{target.source} {target.title}{' (held out)' * target.hold_out}".strip()
        texts = (shown.text(target.value), shown.text(item.mean))
        rows.append((name, *texts, f"{item.ratio:.3f}", f"{item.deviation:.2f}"))
    return ("target", "value", "model", "ratio", "standard deviations"), rows


def _parameter_file(fit: Fit, command: str) -> str:
    """Return a ROS parameter file with the fit's best point; every fitted value is marked."""
    specification = fit.specification
    conditions = specification.conditions
    # The own parameters that all targets have.
    shared = conditions[0] if len(conditions) == 1 else ()
    values = to_values(specification.configuration(fit.best, shared))
    lines = [
        "# Best point of a fit. Values marked as fitted are not measured: the fit chose them so",
        "# that the model gives the targets. Made by",
        f"#   {command}",
        *([f"# No intervals: {fit.refusal}."] if fit.refusal else []),
    ]
    for item in fit.comparisons:
        source = f"{item.target.source}: " if item.target.source else ""
        lines.append(f"# {source}{item}")
    lines += ["/**:", "  ros__parameters:"]
    preset = to_values(to_configuration({"regime": values["regime"]}))
    for name, value in values.items():
        if name == "regime" or name in fit.best or value != preset[name]:
            written = yaml.safe_dump({name: value}, width=math.inf).rstrip()
            lines.append(f"    {written}{_comment(fit, name)}")
    return "\n".join(lines) + "\n"


def _comment(fit: Fit, name: str) -> str:
    """Return the comment behind a fitted value; nothing for others."""
    unit = f" [{unit_of(name)}]" if unit_of(name) else ""
    if name in fit.specification.choices:
        share = sum(p for choices, p in fit.probabilities if choices[name] == fit.best[name])
        allowed = ", ".join(str(value) for value in fit.specification.choices[name])
        return f"  # fitted: probability {share:.2g} among {allowed}{unit}"
    if name not in fit.specification.unknowns:
        return ""
    if (interval := fit.intervals.get(name)) is None:
        return f"  # fitted: no interval{unit}"
    return f"  # fitted: {', '.join((f'{PERCENT} interval {interval}{unit}', *interval.remarks))}"
