"""Page of a sweep: every figure over every swept parameter, with intervals, and its points.

A marker is the mean over all points with one value of the parameter, whatever the other parameters
are. In designs without repeated values it is the mean over a class of neighbouring values. The bar
is the 95 % interval of that mean by Student's t, from the spread of the points; a single point has
the spread of its ensemble.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy import stats

from rpud_sim.pages.frame import render_page
from rpud_sim.pages.plot import Axis, Layer, Plot, Points
from rpud_sim.pages.quantities import NONE, Quantity, figure_quantity, number_text, quantity_in
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.studies.sweep.indices import independent
from rpud_sim.studies.sweep.specification import Range, SweepSpecification, Values, unit_of

_MOST_CLASSES = 12
_CONFIDENCE = 0.95
_MOST_DOTS = 20_000  # of all plots: a dot takes a dozen bytes of the page
_MOST_PLOT_DOTS = 500
_HEIGHT, _WIDTH = 150, 344  # of a plot [pixels]
_ROW = 17  # height of a word [pixels]
_HEADLINES = (
    "drill_tool_impact_rate",
    "contact_force_mean",
    "penetration_rate",
    "energy_absorbed_rate",
    "reacting_force_mean",
)
_MOST_ROWS = 200  # the table of points in Parquet has all
_MOST_AXES = 5  # that are open on the page

_BODY = """\
<p class="verdict">{{ count }} points, {{ design }}: each is the mean over {{ repeat }}.</p>
{% if failures %}
<p class="warning">{{ failures }} simulations have no figures: column <code>failure</code> of
<code>simulations.parquet</code> has the reasons.</p>
{% endif %}
{% for name, reason in missing %}
<p class="warning">{{ name }} has no indices: {{ reason }}.</p>
{% endfor %}
{% if shares %}
<h2 id="shares">Shares of the variance</h2>
<p>An input causes the share <em>alone</em> by itself; <em>in all</em> also counts what it causes
together with others, and the noise of the chaotic motion.</p>
{{ figures(shares, 20) }}
<details><summary>Shares in numbers</summary>
<p>Brackets hold 95 % intervals. <code>indices.json</code> has all numbers.</p>
{{ table(("figure", "input", "alone", "in all"), share_rows, false, "Sobol indices") }}
</details>
{% endif %}
<h2 id="figures">Figures over parameters</h2>
{{ figures(plots, 20) }}
<p class="none">A marker is the mean over all points with one value of the parameter, or with
neighbouring values where every point has its own. Its bar is the 95 % interval of that mean by
Student's t, from the spread of the points; a single point has the spread of its simulations.</p>
{% for name, plots in others %}
<details><summary>{{ name }}</summary>
{{ figures(plots, 20) }}
</details>
{% endfor %}
<details id="parameters"><summary>Parameters</summary>
<p>Seed {{ seed }}. Simulations of one point have initial phases of their own.</p>
{{ table(("swept", "values", "unit"), swept, false, "Swept parameters") }}
{% if fixed %}
{{ table(("fixed", "value", "unit"), fixed, caption="Fixed parameters") }}
{% endif %}
</details>
<details id="points"><summary>Points</summary>
<p>{% if hidden %}The first {{ rows | length }} of {{ hidden + (rows | length) }} points.
{% endif %}
The tables are <code>points.parquet</code> and <code>simulations.parquet</code>, in SI units.</p>
{{ table(heading, rows, caption="Means, and standard errors after ±") }}
</details>
"""


def error_name(figure: str) -> str:
    """Return the name of the column with the standard error of a figure's mean."""
    return f"{figure}_standard_error"


def sweep_page(
    sweep: SweepSpecification,
    points: Mapping[str, np.ndarray],
    failures: int,
    indices: Mapping[str, Any] = MappingProxyType({}),
) -> str:
    """Return the HTML page of a sweep; ``figure_indices`` are of Saltelli's design alone."""
    headlines = headline_figures(sweep)
    found = {name: item for name, item in indices.items() if "missing" not in item}
    drawn = [name for name in headlines if name in found] or list(found)[:1]
    axes = _ordered_axes(sweep, [found[name] for name in drawn])

    def plots(names: Sequence[str], figures: Sequence[str]) -> list[Plot]:
        return [point_plot(sweep, points, *pair) for pair in product(names, figures)]

    count = len(points["point"])
    repeat = "1 simulation" if sweep.repeat == 1 else f"{sweep.repeat} simulations"
    return render_page(
        _BODY,
        f"Sweep over {_listed(list(sweep.axes))}",
        seed=sweep.seed,
        repeat=f"{repeat} of {sweep.duration:g} s",
        count=count,
        design=sweep.design.replace("_", " "),
        failures=failures,
        swept=[(name, _values(spread), unit_of(name)) for name, spread in sweep.axes.items()],
        fixed=[(name, _shown(value), unit_of(name)) for name, value in sweep.fixed.items()],
        shares=[share_plot(name, found[name]) for name in drawn],
        share_rows=list(_shares(found)),
        missing=[(name, item["missing"]) for name, item in indices.items() if "missing" in item],
        plots=plots(axes[:_MOST_AXES], headlines),
        others=[
            *((f"Over {name}", plots([name], headlines)) for name in axes[_MOST_AXES:]),
            *((name, plots(axes, [name])) for name in sweep.figures if name not in headlines),
        ],
        heading=(
            "point",
            *(_headed(name, axis_quantity(sweep, name).unit) for name in sweep.axes),
            "members",
            *(_headed(name, figure_quantity(name).unit) for name in sweep.figures),
        ),
        rows=[_row(sweep, points, i) for i in range(min(count, _MOST_ROWS))],
        hidden=max(count - _MOST_ROWS, 0),
    )


def _ordered_axes(sweep: SweepSpecification, items: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the axes, those first that cause most of the variance, if that is known."""

    def most(name: str) -> float:
        return max((item["inputs"].get(name, {"total": 0.0})["total"] for item in items), default=0)

    return sorted(sweep.axes, key=lambda name: -most(name))


def _listed(names: Sequence[str]) -> str:
    if len(names) > _MOST_AXES:
        return f"{len(names)} parameters"
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _shares(indices: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    """Yield the rows of the table of indices: for each figure the greatest share first."""
    for name, item in indices.items():
        for cause, share in sorted(item["inputs"].items(), key=lambda each: -each[1]["total"]):
            first, total = (
                _interval(share[key], share[f"{key}_interval"]) for key in ("first", "total")
            )
            yield name, cause, first, total
        noise = _interval(item["noise_share"], item["noise_share_interval"])
        yield name, "noise", "", noise


def _interval(value: float, ends: Sequence[float]) -> str:
    """Return a share with its interval."""
    return f"{value:.2f} [{ends[0]:.2f}, {ends[1]:.2f}]"


def _row(sweep: SweepSpecification, points: Mapping[str, np.ndarray], i: int) -> tuple[Any, ...]:
    """Return the number of a point, its places, the members, and the figures with their errors."""
    places = (_placed(sweep, name, points[name][i]) for name in sweep.axes)
    errors = {name: points[error_name(name)][i] for name in sweep.figures}
    means = (_mean(name, points[name][i], error) for name, error in errors.items())
    return (points["point"][i], *places, points["members"][i], *means)


def _placed(sweep: SweepSpecification, name: str, value: Any) -> str:
    if isinstance(value, str | np.str_ | bool | np.bool_):
        return str(value)
    return axis_quantity(sweep, name).text(float(value), unit=False)


def _mean(name: str, mean: float, error: float) -> str:
    if math.isnan(mean):
        return NONE
    shown = figure_quantity(name)
    text = shown.text(mean, unit=False)
    return text if math.isnan(error) else f"{text} ± {error * shown.scale:.1g}"


def _values(spread: Range | Values) -> str:
    if isinstance(spread, Values):
        return ", ".join(map(_shown, spread.values))
    count = f", {spread.points} values" if spread.points else ""
    scale = ", logarithmic" if spread.scale == "log" else ""
    return f"{number_text(spread.minimum)} to {number_text(spread.maximum)}{count}{scale}"


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _headed(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def headline_figures(sweep: SweepSpecification, most: int = 3) -> tuple[str, ...]:
    """Return the figures that the page shows first: the first that the sweep names, or ours."""
    chosen = sweep.figures
    if set(FIGURES) <= set(chosen):
        chosen = tuple(name for name in _HEADLINES if name in chosen)
    return chosen[:most]


def point_plot(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray], name: str, figure: str
) -> Plot:
    """Return the plot of one figure over one axis."""
    points = independent(sweep, points)
    plots = len(sweep.axes) * len(sweep.figures)
    most = max(1, min(_MOST_PLOT_DOTS, _MOST_DOTS // plots))
    spread = sweep.axes[name]
    shown, along = figure_quantity(figure), axis_quantity(sweep, name)
    places = _places(points[name], spread)
    choices = _is_choice(spread)
    scale = 1.0 if choices else along.scale
    layers: list[Layer] = []
    if len(sweep.axes) > 1 or _in_classes(sweep, name):
        every = -(-len(places) // most)
        dots = scale * places[::every], shown.scale * points[figure][::every]
        layers.append(Points("single points", *_turned(dots, choices), size=2.5, color="muted"))
    found = list(marginal_means(sweep, points, name, figure))
    if found:
        at, mean, half = np.array(found).T
        ends = shown.scale * (mean - half), shown.scale * (mean + half)
        marks = _turned((scale * at, shown.scale * mean), choices)
        label = "mean with its 95 % interval"
        layers.append(Points(label, *marks, *ends, across=choices, joined=not choices))
    words = tuple(str(value) for value in spread.levels()) if choices else ()
    alt = _trend(found, shown, along, words)
    if choices:
        axes = Axis(categories=words, flipped=True), Axis(figure, shown.unit)
        height = max(_HEIGHT, _ROW * len(words))
        return Plot(f"{figure} by {name}", tuple(layers), alt, *axes, height, _WIDTH)
    log = isinstance(spread, Range) and spread.scale == "log"
    axes = Axis(unit=shown.unit), Axis(name, along.unit, log)
    return Plot(figure, tuple(layers), alt, *axes, _HEIGHT, _WIDTH)


def _turned(pair: tuple[np.ndarray, np.ndarray], turned: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the places on both axes: words stand below each other."""
    return pair[::-1] if turned else pair


def _trend(
    found: list[tuple[float, float, float]],
    shown: Quantity,
    along: Quantity,
    words: tuple[str, ...],
) -> str:
    """Return where the mean is least and greatest, in words."""
    if not found:
        return "No point has this figure."
    low, high = (extreme(found, key=lambda mark: mark[1]) for extreme in (min, max))
    if low[1] == high[1]:
        return f"{shown.text(low[1])} everywhere."
    least, most = (
        f"{shown.text(mean)} at {words[round(at)] if words else along.text(at)}"
        for at, mean, _ in (low, high)
    )
    return f"Mean: least {least}, greatest {most}."


def share_plot(figure: str, item: Mapping[str, Any]) -> Plot:
    """Return the shares of a figure's variance that inputs cause, the greatest first."""
    causes = sorted(item["inputs"].items(), key=lambda each: -each[1]["total"])
    names = (*(name for name, _ in causes), "noise")
    noise = (item["noise_share"], *item["noise_share_interval"])
    rows = np.array(
        [*((share["total"], *share["total_interval"]) for _, share in causes), noise], float
    )
    value, low, high = rows.T
    places = np.arange(len(names), dtype=float)
    alone = np.array([share["first"] for _, share in causes])
    layers = (
        Points("in all, with its 95 % interval", value, places, low, high, across=True),
        Points("alone", alone, places[:-1] + 0.25, size=5.0, color="muted"),
    )
    alt = f"Greatest share: {names[0]} with {value[0]:.2f}; noise {value[-1]:.2f}."
    axes = Axis(categories=names, flipped=True), Axis("share of the variance")
    return Plot(figure, layers, alt, *axes, _ROW * len(names), _WIDTH)


def _is_choice(spread: Range | Values) -> bool:
    return isinstance(spread, Values) and isinstance(spread.values[0], str | bool)


def axis_quantity(sweep: SweepSpecification, name: str) -> Quantity:
    """Return how an axis is shown."""
    spread = sweep.axes[name]
    if _is_choice(spread):
        return Quantity(name, name, "")
    ends = (spread.minimum, spread.maximum) if isinstance(spread, Range) else spread.values
    return quantity_in(unit_of(name), max(abs(float(end)) for end in ends), name)


def _places(values: np.ndarray, spread: Range | Values) -> np.ndarray:
    """Return the positions of values on an axis: numbers as they are, choices by their index."""
    if isinstance(spread, Values) and _is_choice(spread):
        numbers = {value: number for number, value in enumerate(spread.values)}
        return np.array([numbers[value] for value in values], dtype=float)
    return values


def marginal_means(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray], name: str, figure: str
) -> Iterator[tuple[float, float, float]]:
    """Yield value, mean, and half its 95 % interval for each level or class of a parameter.

    The interval of a single point with a single member is NaN.
    """
    spread = sweep.axes[name]
    places = _places(points[name], spread)
    valid = ~np.isnan(points[figure])
    if _in_classes(sweep, name):
        order = np.argsort(places, kind="stable")
        number = min(math.isqrt(len(places)), _MOST_CLASSES)
        classes = [part[valid[part]] for part in np.array_split(order, number)]
    else:
        classes = [np.flatnonzero(valid & (places == level)) for level in np.unique(places)]
    for members in classes:
        values = points[figure][members]
        if len(values) > 1:
            error = np.std(values, ddof=1) / np.sqrt(len(values))
            freedom = len(values) - 1
        elif len(values) == 1:
            error = points[error_name(figure)][members[0]]
            freedom = points["members"][members[0]] - 1
        else:
            continue
        half = stats.t.ppf(0.5 + 0.5 * _CONFIDENCE, freedom) * error if freedom else np.nan
        yield float(places[members].mean()), float(values.mean()), float(half)


def _in_classes(sweep: SweepSpecification, name: str) -> bool:
    """Whether a parameter has a different value at every point."""
    return sweep.design != "grid" and isinstance(sweep.axes[name], Range)
