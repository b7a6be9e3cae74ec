"""Page of a sweep, and Sobol indices: which parameter causes how much of a figure's variance.

The points of the indices are Saltelli's design. Its first matrix stands in it twice, with other
initial phases: the motion is chaotic, and the total index of this change of nothing is the share of
the noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats
from scipy.stats import sobol_indices

from rpud_sim.foundation.shown_quantities import (
    ShownQuantity,
    figure_quantity,
    number_text,
    quantity_in,
)
from rpud_sim.pages.frame import Picture, colors, picture, render_page
from rpud_sim.studies.sweep.specification import (
    SWEEP_FIGURES,
    Range,
    SweepSpecification,
    Values,
    error_name,
    unit_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_CLASSES = 12
_MOST_COLORS = 5  # values of the second factor
_CONFIDENCE = 0.95
_RESAMPLES = 400
_MOST_DOTS = 3_000  # of all pictures: a dot takes a hundred bytes of the page
_MOST_PLOT_DOTS = 300
_HEIGHT = 190  # of a picture [pixels]
_ROW = 17  # height of a word [pixels]
# They come first; so many figures are open on the page.
_HEADLINES = (
    "drill_tool_impact_rate",
    "contact_force_mean",
    "penetration_rate",
    "energy_absorbed_rate",
    "reacting_force_mean",
)
_OPEN = 3

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
together with others, and the noise of the chaotic motion. <code>indices.json</code> has the
numbers.</p>
{{ figures(shares, 20) }}
{% endif %}
<h2 id="figures">Figures over parameters</h2>
<p class="none">A marker is the mean over all points with one value of the parameter, or with
neighbouring values where every point has its own. In a grid each value of the factor with the
fewest values has its own colour. Bar or band are the 95 % interval of that mean by
Student's t, from the spread of the points; a single point has the spread of its simulations.</p>
{% for name, plots in plots %}
<details{{ " open" if loop.index <= open }}><summary>{{ name.replace("_", " ") }}</summary>
{{ figures(plots, 20) }}
</details>
{% endfor %}
<details id="parameters"><summary>Parameters</summary>
<p>Seed {{ seed }}. Simulations of one point have initial phases of their own. The points are in
<code>points.parquet</code>, in SI units.</p>
{{ table(("parameter", "values", "unit"), parameters, false, "Swept and fixed parameters") }}
</details>
"""


def sweep_page(
    sweep: SweepSpecification,
    points: Mapping[str, np.ndarray],
    failures: int,
    indices: Mapping[str, Any] = MappingProxyType({}),
) -> str:
    """Return the HTML page of a sweep; ``figure_indices`` are of Saltelli's design alone."""
    figures = sorted(sweep.figures, key=lambda name: name not in _HEADLINES)
    found = {name: indices[name] for name in figures if "inputs" in indices.get(name, {})}
    count = len(points["point"])
    repeat = "1 simulation" if sweep.repeat == 1 else f"{sweep.repeat} simulations"
    return render_page(
        _BODY,
        f"Sweep over {', '.join(sweep.axes).replace('_', ' ')}",
        seed=sweep.seed,
        repeat=f"{repeat} of {sweep.duration:g} s",
        count=count,
        design=sweep.design.replace("_", " "),
        failures=failures,
        parameters=[
            (name, _values(spread), unit_of(name))
            for name, spread in (sweep.axes | dict(sweep.fixed)).items()
        ],
        shares=[share_picture(name, item) for name, item in found.items()],
        missing=[(name, item["missing"]) for name, item in indices.items() if "missing" in item],
        plots=[
            (figure, [point_picture(sweep, points, name, figure) for name in sweep.axes])
            for figure in figures
        ],
        open=_OPEN,
    )


def _values(spread: Any) -> str:
    """Return the values of an axis, or the only one of a fixed parameter."""
    if isinstance(spread, Values):
        return ", ".join(map(_values, spread.values))
    if not isinstance(spread, Range):
        return f"{spread:.6g}" if isinstance(spread, float) else str(spread)
    count = f", {spread.points} values" if spread.points else ""
    scale = ", logarithmic" if spread.scale == "log" else ""
    return f"{number_text(spread.minimum)} to {number_text(spread.maximum)}{count}{scale}"


def point_picture(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray], name: str, figure: str
) -> Picture:
    """Return a figure over an axis: single points, means and intervals by the second factor."""
    points = independent(sweep, points)
    spread, shown, along = sweep.axes[name], figure_quantity(figure), axis_quantity(sweep, name)
    choices, label, by = _is_choice(spread), shown.label, name.replace("_", " ")
    scales = np.array([along.scale, shown.scale, shown.scale])[:, None]
    groups = [
        (text, np.array(list(marginal_means(sweep, part, name, figure))).reshape(-1, 3).T * scales)
        for text, part in _by_second_factor(sweep, points, name)
    ]
    mean = np.concatenate([found[1] for _, found in groups])
    plots = len(sweep.axes) * len(sweep.figures)
    every = -(-len(points["point"]) // max(1, min(_MOST_PLOT_DOTS, _MOST_DOTS // plots)))
    places = along.scale * _places(points[name], spread)[::every]
    values = shown.scale * points[figure][::every]
    words = tuple(map(str, spread.levels())) if choices else ()

    def draw(axes: Axes) -> None:
        color, unit = colors(), f" [{shown.unit}]" if shown.unit else ""
        style: dict[str, Any] = {"ms": 3, "color": color["muted"], "alpha": 0.5}
        axes.plot(*((values, places) if choices else (places, values)), ".", **style)
        if isinstance(spread, Range) and spread.scale == "log":
            axes.set_xscale("log")
        for number, (text, (at, middle, half)) in enumerate(groups):
            if choices:
                beside = 0.16 * (number - 0.5 * (len(groups) - 1))
                axes.errorbar(
                    middle, at + beside, xerr=half, fmt="o", ms=4, capsize=2, label=text or None
                )
                continue
            kind = "o-" if len(at) <= _MOST_CLASSES else "-"
            axes.plot(at, middle, kind, ms=4, label=text or None)
            axes.fill_between(at, middle - half, middle + half, alpha=0.3 if not text else 0.15)
        if choices:
            axes.set_yticks(range(len(words)), words)
            axes.set_ylim(len(words) - 0.4, -0.6)
        along_unit = f" [{along.unit}]" if along.unit else ""
        axes.set_xlabel(f"{label}{unit}" if choices else f"{by}{along_unit}")

    alt = "No point has this figure."
    if len(mean):
        ends = (shown.text(value / shown.scale) for value in (mean.min(), mean.max()))
        alt = f"Mean from {' to '.join(ends)}."
    title = f"{label} by {by}" if choices or not shown.unit else f"{label} [{shown.unit}] by {by}"
    return picture(title, alt, draw, max(_HEIGHT, 70 + _ROW * len(words)))


def _by_second_factor(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray], name: str
) -> Iterator[tuple[str, Mapping[str, np.ndarray]]]:
    """Yield the points of each value of a grid's second factor, in words.

    It is the factor with the fewest values; means over all of them would hide what it does. Without
    one of at most ``_MOST_COLORS`` values these are all points, without words.
    """
    others = [(axis.count, each) for each, axis in sweep.axes.items() if each != name]
    count, other = min(others, default=(0, ""))
    if sweep.design != "grid" or not 1 < count <= _MOST_COLORS:
        yield "", points
        return
    shown = axis_quantity(sweep, other)
    for level in np.unique(points[other]):
        value = shown.text(float(level)) if not _is_choice(sweep.axes[other]) else str(level)
        chosen = points[other] == level
        yield value, {each: values[chosen] for each, values in points.items()}


def share_picture(figure: str, item: Mapping[str, Any]) -> Picture:
    """Return the shares of a figure's variance that inputs cause, the greatest first."""
    causes = sorted(item["inputs"].items(), key=lambda each: -each[1]["total"])
    names = (*(name.replace("_", " ") for name, _ in causes), "noise")
    rows: list[Sequence[float]] = [(s["total"], *s["total_interval"]) for _, s in causes]
    value, low, high = np.array([*rows, (item["noise_share"], *item["noise_share_interval"])]).T
    alone = [share["first"] for _, share in causes]

    def draw(axes: Axes) -> None:
        places, reach = np.arange(len(names)), np.maximum([value - low, high - value], 0.0)
        axes.errorbar(value, places, xerr=reach, fmt="o", ms=5, capsize=2, label="in all")
        axes.plot(alone, places[:-1] + 0.25, "o", ms=4, color=colors()["muted"], label="alone")
        axes.set_yticks(places, names)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_xlabel("share of the variance")

    alt = f"Greatest share: {names[0]} with {value[0]:.2f}; noise {value[-1]:.2f}."
    return picture(figure_quantity(figure).label, alt, draw, 90 + _ROW * len(names))


def _is_choice(spread: Range | Values) -> bool:
    return isinstance(spread, Values) and isinstance(spread.values[0], str | bool)


def axis_quantity(sweep: SweepSpecification, name: str) -> ShownQuantity:
    """Return how an axis is shown."""
    spread = sweep.axes[name]
    if _is_choice(spread):
        return ShownQuantity(name, name, "")
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

    Values of a range that no two points share are put into classes of neighbours. The interval of a
    single point with a single member is NaN.
    """
    spread = sweep.axes[name]
    places = _places(points[name], spread)
    valid = ~np.isnan(points[figure])
    if sweep.design != "grid" and isinstance(spread, Range):
        order = np.argsort(places, kind="stable")
        number = min(math.isqrt(len(places)), _MOST_CLASSES)
        classes = [part[valid[part]] for part in np.array_split(order, number)]
    else:
        classes = [np.flatnonzero(valid & (places == level)) for level in np.unique(places)]
    for members in filter(len, classes):
        values = points[figure][members]
        freedom = len(values) - 1
        if freedom:
            error = np.std(values, ddof=1) / np.sqrt(len(values))
        else:
            error = points[error_name(figure)][members[0]]
            freedom = points["members"][members[0]] - 1
        half = stats.t.ppf(0.5 + 0.5 * _CONFIDENCE, freedom) * error if freedom else np.nan
        yield float(places[members].mean()), float(values.mean()), float(half)


def find_indices(values: np.ndarray, seed: int) -> np.ndarray:
    """Return first and total indices, with their intervals, shape (3, 2, figures, inputs).

    The first index is the share of the variance that an input explains alone, the total one that in
    which it takes part. Finite values have shape (matrices, samples, figures), in the order of
    ``saltelli_shares``.
    """
    a, b, mixed = values[0].T, values[1].T, np.swapaxes(values[2:], 1, 2)
    samples = a.shape[1]
    random = np.random.default_rng(seed)

    def estimate(chosen: np.ndarray) -> np.ndarray:
        # A resample of few points may have no variance to divide.
        with np.errstate(divide="ignore", invalid="ignore"):
            found = sobol_indices(
                func={"f_A": a[:, chosen], "f_B": b[:, chosen], "f_AB": mixed[..., chosen]},
                n=samples,
            )
        # SciPy drops the axis of the figures if there is only one.
        return np.array([found.first_order, found.total_order]).reshape(2, len(a), -1)

    found = estimate(np.arange(samples))
    resampled = np.array(
        [estimate(random.integers(0, samples, samples)) for _ in range(_RESAMPLES)]
    )
    tail = 0.5 * (1.0 - _CONFIDENCE)
    ends = np.nanquantile(resampled, [tail, 1.0 - tail], axis=0)
    return np.concatenate([found[None], ends])


def figure_indices(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray]
) -> dict[str, dict[str, Any]]:
    """Return distribution and indices of each figure as plain values.

    A figure that a point lacks has the entry ``missing`` instead, which gives the reason.
    """
    reasons = {name: _missing(points, name) for name in sweep.figures}
    names = [name for name, reason in reasons.items() if not reason]
    plain: dict[str, dict[str, Any]] = {}
    if names:
        shape = (len(sweep.swept) + 3, sweep.points or 0, len(names))
        values = np.column_stack([points[name] for name in names]).reshape(shape)
        found = find_indices(values, sweep.seed)
        for i, name in enumerate(names):
            plain[name] = _plain(list(sweep.swept), values[:2, :, i].ravel(), found[:, :, i])
    return {
        name: {"unit": SWEEP_FIGURES[name], **plain.get(name, {"missing": reason})}
        for name, reason in reasons.items()
    }


def independent(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray]
) -> Mapping[str, np.ndarray]:
    """Return the points that do not repeat values of others: in Saltelli's design A and B."""
    if sweep.design != "saltelli":
        return points
    return {name: values[: 2 * (sweep.points or 0)] for name, values in points.items()}


def _missing(points: Mapping[str, np.ndarray], name: str) -> str:
    """Return why a figure has no indices; empty if it has."""
    values = points[name]
    lacking = np.flatnonzero(np.isnan(values))
    if len(lacking):
        first = int(lacking[0])
        failed = points["members"][first] == 0
        reason = "every simulation failed" if failed else "there is nothing to average"
        return f"{len(lacking)} of {len(values)} points lack it; at point {first} {reason}"
    if np.ptp(values) == 0.0:
        return "it is the same at all points"
    return ""


def _plain(names: list[str], values: np.ndarray, indices: np.ndarray) -> dict[str, Any]:
    """Return distribution and indices, shape (3, 2, inputs), of one figure."""
    value, *ends = indices
    first, total = value.tolist()
    first_ends, total_ends = np.array(ends).transpose(1, 2, 0).tolist()
    return {
        "mean": float(values.mean()),
        "standard_deviation": float(values.std(ddof=1)),
        "interval_90": np.quantile(values, [0.05, 0.95]).tolist(),
        "noise_share": total[-1],
        "noise_share_interval": total_ends[-1],
        "inputs": {
            name: {
                "first": first[i],
                "first_interval": first_ends[i],
                "total": total[i],
                "total_interval": total_ends[i],
            }
            for i, name in enumerate(names)
        },
    }
