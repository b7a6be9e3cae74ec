"""Page of a sweep: every figure over every swept parameter, and its points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from rpud_sim.pages import figures  # noqa: F401 - where Bokeh is missing, it fails before a run
from rpud_sim.pages.frame import render_page
from rpud_sim.pages.words import number
from rpud_sim.studies.sweep.point_plots import point_plots, unit_of
from rpud_sim.studies.sweep.specification import SWEEP_FIGURES, Range, SweepSpecification, Values
from rpud_sim.studies.sweep.tables import error_name

_MOST_ROWS = 200  # the table of points in Parquet has all

_BODY = """\
<p>Seed {{ seed }}. Each point is the mean over {{ repeat }} simulations of {{ duration }} s with
initial phases of their own. The tables are <code>points.parquet</code> and
<code>simulations.parquet</code>.</p>
<div class="tiles">
{% for name, value in tiles %}
<div class="tile"><b>{{ value }}</b>{{ name }}</div>
{% endfor %}
</div>
{% if failures %}
<p class="warning">{{ failures }} simulations have no figures: column <code>failure</code> of
<code>simulations.parquet</code> has the reasons.</p>
{% endif %}
{% if sections | length > 1 %}
<nav aria-label="Sections">
{% for section in sections %}
<a href="#over-{{ section.name }}">{{ section.name }}</a>
{% endfor %}
<a href="#points">Points</a>
</nav>
{% endif %}
<h2>Parameters</h2>
{{ table(("swept", "values", "unit"), swept, false, "Swept parameters") }}
{% if fixed %}
{{ table(("fixed", "value", "unit"), fixed, caption="Fixed parameters") }}
{% endif %}
{% if shares or missing %}
<h2 id="shares">Shares of the variance</h2>
<p>An input causes the share <em>alone</em> by itself; <em>in all</em> also counts what it causes
together with others, and the noise of the chaotic motion. Brackets hold 95 % intervals.
<code>indices.json</code> has all numbers.</p>
{{ table(("figure", "input", "alone", "in all"), shares, false, "Sobol indices") }}
{% for name, reason in missing %}
<p class="warning">{{ name }} has no indices: {{ reason }}.</p>
{% endfor %}
{% endif %}
{% for section in sections %}
<h2 id="over-{{ section.name }}">Figures over {{ section.name }}</h2>
{% if loop.first %}
<p>A marker is the mean over all points with one value of the parameter, or with neighbouring values
where every point has its own. Its bar is the 95 % interval of that mean by Student's t, from the
spread of the points; a single point has the spread of its simulations. Dots are single points.</p>
{% endif %}
{{ grid(section.name, section.plots, 20) }}
{% endfor %}
<h2 id="points">Points</h2>
{% if hidden %}
<p>The first {{ rows | length }} of {{ hidden + (rows | length) }} points;
<code>points.parquet</code> has all.</p>
{% endif %}
{{ table(heading, rows, caption="Means, and standard errors after ±") }}
"""


def sweep_page(
    specification: SweepSpecification,
    points: Mapping[str, np.ndarray],
    failures: int,
    indices: Mapping[str, Any] = MappingProxyType({}),
) -> str:
    """Return the HTML page of a sweep.

    Args:
        indices: those of ``figure_indices``; none in other designs than Saltelli's.
    """
    sections = [
        {"name": name, "plots": plots} for name, plots in point_plots(specification, points).items()
    ]
    count = len(points["point"])
    return render_page(
        _BODY,
        "Sweep",
        seed=specification.seed,
        repeat=specification.repeat,
        duration=f"{specification.duration:g}",
        tiles=(
            ("design", specification.design.replace("_", " ")),
            ("points", count),
            ("simulations", specification.simulations),
            ("failed", failures),
        ),
        failures=failures,
        swept=[
            (name, _values(spread), unit_of(name)) for name, spread in specification.axes.items()
        ],
        fixed=[(name, _shown(value), unit_of(name)) for name, value in specification.fixed.items()],
        shares=list(_shares(indices)),
        missing=[(name, item["missing"]) for name, item in indices.items() if "missing" in item],
        sections=sections,
        heading=(
            "point",
            *(_headed(name, unit_of(name)) for name in specification.axes),
            "members",
            *(_headed(name, SWEEP_FIGURES[name]) for name in specification.figures),
        ),
        rows=[_row(specification, points, i) for i in range(min(count, _MOST_ROWS))],
        hidden=max(count - _MOST_ROWS, 0),
    )


def _shares(indices: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    """Yield the rows of the table of indices: for each figure the greatest share first."""
    for name, item in indices.items():
        if "missing" in item:
            continue
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


def _row(
    specification: SweepSpecification, points: Mapping[str, np.ndarray], i: int
) -> tuple[Any, ...]:
    return (
        points["point"][i],
        *(_shown(points[name][i]) for name in specification.axes),
        points["members"][i],
        *(_mean(points[name][i], points[error_name(name)][i]) for name in specification.figures),
    )


def _mean(mean: float, error: float) -> str:
    if math.isnan(mean):
        return "–"
    return number(mean) if math.isnan(error) else f"{number(mean)} ± {error:.1g}"


def _values(spread: Range | Values) -> str:
    if isinstance(spread, Values):
        return ", ".join(map(_shown, spread.values))
    count = f", {spread.points} values" if spread.points else ""
    scale = ", logarithmic" if spread.scale == "log" else ""
    return f"{number(spread.minimum)} to {number(spread.maximum)}{count}{scale}"


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _headed(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name
