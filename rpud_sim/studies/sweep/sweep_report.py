"""Page of a sweep: every figure over every swept parameter, and its points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np

from rpud_sim.pages.frame import render_page
from rpud_sim.pages.plot import Plot
from rpud_sim.pages.quantities import NONE, figure_quantity, number_text
from rpud_sim.studies.sweep.point_plots import (
    axis_quantity,
    headline_figures,
    point_plot,
    share_plot,
    unit_of,
)
from rpud_sim.studies.sweep.specification import Range, SweepSpecification, Values
from rpud_sim.studies.sweep.tables import error_name

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
    headlines = headline_figures(specification)
    found = {name: item for name, item in indices.items() if "missing" not in item}
    drawn = [name for name in headlines if name in found] or list(found)[:1]
    axes = _ordered_axes(specification, [found[name] for name in drawn])

    def plots(names: Sequence[str], figures: Sequence[str]) -> list[Plot]:
        return [point_plot(specification, points, *pair) for pair in product(names, figures)]

    count = len(points["point"])
    repeat = "1 simulation" if specification.repeat == 1 else f"{specification.repeat} simulations"
    return render_page(
        _BODY,
        f"Sweep over {_listed(list(specification.axes))}",
        seed=specification.seed,
        repeat=f"{repeat} of {specification.duration:g} s",
        count=count,
        design=specification.design.replace("_", " "),
        failures=failures,
        swept=[
            (name, _values(spread), unit_of(name)) for name, spread in specification.axes.items()
        ],
        fixed=[(name, _shown(value), unit_of(name)) for name, value in specification.fixed.items()],
        shares=[share_plot(name, found[name]) for name in drawn],
        share_rows=list(_shares(found)),
        missing=[(name, item["missing"]) for name, item in indices.items() if "missing" in item],
        plots=plots(axes[:_MOST_AXES], headlines),
        others=[
            *((f"Over {name}", plots([name], headlines)) for name in axes[_MOST_AXES:]),
            *(
                (name, plots(axes, [name]))
                for name in specification.figures
                if name not in headlines
            ),
        ],
        heading=(
            "point",
            *(
                _headed(name, axis_quantity(specification, name).unit)
                for name in specification.axes
            ),
            "members",
            *(_headed(name, figure_quantity(name).unit) for name in specification.figures),
        ),
        rows=[_row(specification, points, i) for i in range(min(count, _MOST_ROWS))],
        hidden=max(count - _MOST_ROWS, 0),
    )


def _ordered_axes(
    specification: SweepSpecification, items: Sequence[Mapping[str, Any]]
) -> list[str]:
    """Return the axes, those first that cause most of the variance, if that is known."""

    def most(name: str) -> float:
        return max((item["inputs"].get(name, {"total": 0.0})["total"] for item in items), default=0)

    return sorted(specification.axes, key=lambda name: -most(name))


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


def _row(
    specification: SweepSpecification, points: Mapping[str, np.ndarray], i: int
) -> tuple[Any, ...]:
    return (
        points["point"][i],
        *(_placed(specification, name, points[name][i]) for name in specification.axes),
        points["members"][i],
        *(
            _mean(name, points[name][i], points[error_name(name)][i])
            for name in specification.figures
        ),
    )


def _placed(specification: SweepSpecification, name: str, value: Any) -> str:
    if isinstance(value, str | np.str_ | bool | np.bool_):
        return str(value)
    return axis_quantity(specification, name).text(float(value), unit=False)


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
