"""Files of a fit: numbers, posterior, parameter file, and a page with plots."""

from __future__ import annotations

import dataclasses
import io
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.json_values import finite_values
from rpud_sim.foundation.quantities import Flag, Quantity
from rpud_sim.pages.frame import render_page
from rpud_sim.pages.plot import Axis, Layer, Line, Plot, Points, Rule, Zone
from rpud_sim.pages.quantities import ShownQuantity, quantity_in
from rpud_sim.simulation.configuration import PARAMETERS, to_values
from rpud_sim.studies.fit.fit import BEST_RUNS, Fit, TargetComparison
from rpud_sim.studies.fit.posterior import LEVEL, PERCENT, Identifiability
from rpud_sim.studies.fit.rounds import fit_versions
from rpud_sim.studies.store import write_whole
from rpud_sim.studies.sweep.specification import unit_of

_MOST_DOTS = 1500
_BINS = 40
_TAIL = 0.002  # share of the posterior beyond each end of what is shown
_MARGIN = 0.15  # of what is shown, on each side
_HEIGHT, _WIDTH = 150, 344  # of a plot of the posterior [pixels]
_ROW = 26  # height of a target [pixels]
_COLUMN = 43  # of the parameter file, where comments begin
_IMPACT_DYNAMICS_END = "regime"  # last of the parameters that are always written

_BODY = """\
<p class="verdict">{{ verdict }} Root mean square of the deviations: {{ misfit }}.</p>
{% if refusal %}
<p class="warning">There are no intervals: {{ refusal }}.</p>
{% endif %}
{% for miss in missed %}
<p class="warning">{{ miss }}</p>
{% endfor %}
{% if singles %}
<h2>Posterior of the unknown parameters</h2>
{{ figures(singles) }}
{% endif %}
{% if pairs %}
<details><summary>Posterior of pairs</summary>
{{ figures(pairs) }}
</details>
{% endif %}
{% if ridges %}
<p class="warning">The targets determine these pairs only together:
{% for ridge in ridges %}{{ ridge }}{{ "." if loop.last else "; " }}{% endfor %}</p>
{% endif %}
{{ table(heading, unknowns, caption="Unknown parameters") }}
{% if choices %}
{{ table(("choices", "probability"), choices, caption="Choices") }}
{% endif %}
{{ figure(target_plot) }}
<details><summary>How to read it</summary>
<p>Made by <code>{{ command }}</code>. Seed {{ seed }}, {{ runs }} runs. The model's figures are
means of {{ best_runs }} runs at the best point. All numbers are in fit.json.
{% if not refusal %}
Intervals hold {{ percent }} of the posterior probability. All values between the bounds were
equally probable before the fit. The plots show where the posterior is; the bounds may be outside.
The width is that of the interval over that between the bounds: near 1, the targets say nothing
about the parameter.
{% endif %}</p>
</details>
"""


def write_fit(fit: Fit, folder: Path, command: str) -> None:
    """Write all files of a fit to a folder; the command makes them again."""
    write_whole(folder / "fit.json", json.dumps(fit_content(fit), indent=1, allow_nan=False) + "\n")
    write_whole(folder / "parameters.yaml", _parameter_file(fit, command))
    if not fit.refusal:
        text = io.StringIO()
        columns, heading = np.column_stack(list(fit.samples.values())), ",".join(fit.samples)
        np.savetxt(text, columns, fmt="%.9g", delimiter=",", header=heading, comments="")
        write_whole(folder / "posterior.csv", text.getvalue())
    write_whole(folder / "report.html", _page(fit, command))


def fit_content(fit: Fit) -> dict[str, Any]:
    """Return all numbers of a fit as plain values."""
    found = fit.found
    content = {
        "reached": fit.reached,
        "missed": [item.target.title for item in fit.missed],
        "refusal": fit.refusal or None,
        "best": dict(fit.best),
        "level": LEVEL,
        "unknowns": {
            name: {"best": fit.best[name], "unit": unit_of(name)}
            | (
                {}
                if found is None
                else {
                    **dataclasses.asdict(found.intervals[name]),
                    "identified": found.intervals[name].identified,
                }
            )
            for name in fit.specification.unknowns
        },
        "choices": [
            {"choices": dict(choices), "probability": share} for choices, share in fit.probabilities
        ],
        "ridges": [
            {"parameters": list(ridge.names), "correlation": ridge.correlation}
            for ridge in (found.ridges if found else ())
        ],
        "targets": [_comparison(item) for item in fit.comparisons],
        "misfit": fit.misfit(False),
        "hold_out_misfit": fit.misfit(True),
        "seed": fit.specification.seed,
        "simulations": fit.simulations + fit.kept,
        "versions": fit_versions(),
        "specification": fit.specification.content(),
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


def _page(fit: Fit, command: str) -> str:
    found = fit.found
    used = sum(not item.target.hold_out for item in fit.comparisons)
    missed = f"Not met: the model does not reach {len(fit.missed)} of {used} targets."
    reached = f"The model reaches all {used} targets that the fit used."
    heading = ("parameter", "best point", f"{PERCENT} interval", "width", "remarks")
    return render_page(
        _BODY,
        "Fit of a drill",
        command=command,
        seed=fit.specification.seed,
        verdict=reached if fit.reached else missed,
        refusal=fit.refusal,
        missed=[item.miss for item in fit.missed],
        runs=fit.simulations + fit.kept,
        percent=PERCENT,
        heading=heading if found else heading[:2],
        unknowns=[_unknown(fit, name) for name in fit.specification.unknowns],
        choices=[(choices, f"{share:.3f}") for choices, share in fit.choices],
        ridges=[str(ridge) for ridge in found.ridges] if found else [],
        singles=single_plots(fit, found) if found else [],
        pairs=_pair_plots(fit) if found else [],
        target_plot=target_plot(fit),
        best_runs=BEST_RUNS,
        misfit=fit.misfit_text,
    )


def _unknown(fit: Fit, name: str) -> tuple[str, ...]:
    """Return name, best point, interval, width and remarks of an unknown."""
    shown = unknown_quantity(fit, name)
    best = (name, shown.text(fit.best[name]))
    if fit.found is None:
        return best
    interval = fit.found.intervals[name]
    ends = f"{shown.text(interval.low, unit=False)} to {shown.text(interval.high)}"
    return (*best, ends, f"{interval.width:.2f}", "; ".join(interval.remarks))


def unknown_quantity(fit: Fit, name: str) -> ShownQuantity:
    """Return how an unknown is shown."""
    greatest = abs(fit.specification.unknowns[name].maximum)
    digits = fit.found.intervals[name].digits if fit.found else 4
    return dataclasses.replace(quantity_in(unit_of(name), greatest, name), digits=digits)


def single_plots(fit: Fit, found: Identifiability) -> list[Plot]:
    """Return the posterior of every unknown."""
    plots = []
    for name, interval in found.intervals.items():
        axis, scale = _axis(fit, name), unknown_quantity(fit, name).scale
        space = np.geomspace if axis.log else np.linspace
        edges = space(axis.low or 0.0, axis.high or 0.0, _BINS + 1)
        shares = np.histogram(scale * fit.samples[name], edges)[0] / len(fit.samples[name])
        layers: tuple[Layer, ...] = (
            Zone(f"{PERCENT} interval", scale * interval.low, scale * interval.high, False),
            Line("posterior", edges, np.append(shares, 0.0), steps=True),
            Rule("best point", scale * fit.best[name], False, "series1", "solid"),
        )
        _, best, ends, *_ = _unknown(fit, name)
        alt = f"Best point {best}, {PERCENT} interval {ends}."
        plots.append(Plot(name, layers, alt, Axis(low=0.0), axis, _HEIGHT, _WIDTH))
    return plots


def _pair_plots(fit: Fit) -> list[Plot]:
    """Return the posterior of every pair of unknowns."""
    every = -(-len(fit.shares) // _MOST_DOTS)
    scales = {name: unknown_quantity(fit, name).scale for name in fit.specification.unknowns}
    dots = {name: scale * fit.samples[name][::every] for name, scale in scales.items()}
    best = {name: np.array([scale * fit.best[name]]) for name, scale in scales.items()}
    return [
        Plot(
            y,
            (
                Points("posterior", dots[x], dots[y], size=2.5),
                Points("best point", best[x], best[y], marker="x", size=10.0, color="series1"),
            ),
            y=_axis(fit, y),
            x=_axis(fit, x),
            height=_HEIGHT,
            width=_WIDTH,
        )
        for x, y in itertools.combinations(scales, 2)
    ]


def _axis(fit: Fit, name: str) -> Axis:
    """Return the axis of an unknown: where its posterior and best point are, within the bounds."""
    spread, shown = fit.specification.unknowns[name], unknown_quantity(fit, name)
    ends = [*np.quantile(fit.samples[name], [_TAIL, 1.0 - _TAIL]).tolist(), fit.best[name]]
    # A posterior of one point has no width.
    more = max(_MARGIN * (max(ends) - min(ends)), 1e-3 * (spread.maximum - spread.minimum))
    low, high = max(min(ends) - more, spread.minimum), min(max(ends) + more, spread.maximum)
    return Axis(name, shown.unit, spread.scale == "log", shown.scale * low, shown.scale * high)


def target_plot(fit: Fit) -> Plot:
    """Return the model over each target, with the target's tolerance."""
    shown = [item for item in fit.comparisons if item.target.value]
    places = np.arange(len(shown), dtype=float)
    tolerance = np.array([abs(item.target.error(0.0) / item.target.value) for item in shown])
    layers: list[Layer] = [
        Rule("", 1.0, False, dash="solid"),
        Points(
            "tolerance of the target", np.ones(len(shown)), places + 0.25,
            1.0 - tolerance, 1.0 + tolerance, across=True, size=3.0, color="muted",
        ),
    ]  # fmt: skip
    for held, name, color in (
        (False, "model at the best point", "series0"),
        (True, "held out", "series2"),
    ):
        chosen = [i for i, item in enumerate(shown) if item.target.hold_out == held]
        if chosen:
            ratio = np.array([shown[i].ratio for i in chosen])
            titles = tuple(str(shown[i]) for i in chosen)
            layers.append(Points(name, ratio, places[chosen], size=8.0, color=color, titles=titles))
    texts = [_texts(item) for item in shown]
    columns = (
        tuple(zip(("target", "model"), zip(*texts, strict=True), strict=True)) if texts else ()
    )
    titles = tuple(
        f"{item.target.source} {item.target.title}{' (held out)' * item.target.hold_out}".strip()
        for item in shown
    )
    far = max(shown, key=lambda item: abs(item.deviation), default=None)
    alt = "" if far is None else f"Furthest: {far}."
    up = Axis(categories=titles, flipped=True, columns=columns)
    return Plot("Targets", tuple(layers), alt, up, Axis("model / target"), _ROW * len(shown), 1068)


def _texts(item: TargetComparison) -> tuple[str, str]:
    shown = quantity_in(item.target.measure.unit, abs(item.target.value))
    return shown.text(item.target.value), shown.text(item.mean)


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
    names = list(PARAMETERS)
    always = names[: names.index(_IMPACT_DYNAMICS_END) + 1]
    ordered = ["regime", *(name for name in names if name != "regime")]
    for name in ordered:
        if name not in values:
            continue
        if name not in always and values[name] == PARAMETERS[name].default:
            continue
        value = _written(name, values[name])
        lines.append(f"{f'    {name}: {value}':{_COLUMN}} {_comment(fit, name)}")
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _written(name: str, value: object) -> str:
    """Return a value as YAML that ROS reads with the right type."""
    if isinstance(PARAMETERS[name].allowed, Flag):
        return str(value).lower()
    if isinstance(value, float):
        text = f"{value:.6g}" if float(f"{value:.6g}") == value else repr(value)
        mantissa, e, exponent = text.partition("e")
        return (mantissa if "." in mantissa else f"{mantissa}.0") + e + exponent
    return str(value)


def _comment(fit: Fit, name: str) -> str:
    unit = f" [{unit_of(name)}]" if unit_of(name) else ""
    if name in fit.specification.unknowns:
        if fit.found is None:
            return f"# fitted: no interval{unit}"
        interval = fit.found.intervals[name]
        return f"# fitted: {', '.join((f'{PERCENT} interval {interval}{unit}', *interval.remarks))}"
    if name in fit.specification.choices:
        share = sum(p for choices, p in fit.probabilities if choices[name] == fit.best[name])
        allowed = ", ".join(str(value) for value in fit.specification.choices[name])
        return f"# fitted: probability {share:.2g} among {allowed}{unit}"
    if not isinstance(PARAMETERS[name].allowed, Quantity):
        return ""
    return f"#{unit}" if unit else ""
