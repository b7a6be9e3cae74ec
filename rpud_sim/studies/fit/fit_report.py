"""Files of a fit: numbers, posterior, parameter file and an HTML page."""

from __future__ import annotations

import dataclasses
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.whole_folder import whole_file
from rpud_sim.pages.frame import corner, render_page
from rpud_sim.studies.fit.fit import BEST_RUNS, Comparison, Fit
from rpud_sim.studies.fit.fit_plots import corner_rows, corner_text, target_plot, unknown_quantity
from rpud_sim.studies.fit.folder import fit_versions
from rpud_sim.studies.fit.identifiability import LEVEL, PERCENT, Interval
from rpud_sim.studies.fit.parameter_file import parameter_file
from rpud_sim.studies.fit.specification import unit_of

NUMBERS = "fit.json"
PARAMETERS = "parameters.yaml"
POSTERIOR = "posterior.csv"
REPORT = "report.html"

_BODY = """\
<p class="verdict">{{ verdict }} Root mean square of the deviations: {{ misfit }}.</p>
{% if refusal %}
<p class="warning">There are no intervals: {{ refusal }}.</p>
{% endif %}
{% for miss in missed %}
<p class="warning">{{ miss }}</p>
{% endfor %}
{{ corner }}
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
    """Write all files of a fit.

    Args:
        folder: of the files; it exists.
        command: that makes them again.
    """
    numbers = json.dumps(fit_content(fit), indent=1, allow_nan=False)
    _write(folder / NUMBERS, f"{numbers}\n".encode())
    _write(folder / PARAMETERS, parameter_file(fit, command).encode())
    if not fit.refusal:
        _write(folder / POSTERIOR, _posterior(fit))
    _write(folder / REPORT, _page(fit, command).encode())


def fit_content(fit: Fit) -> dict[str, Any]:
    """Return all numbers of a fit as plain values."""
    found = fit.found
    return {
        "reached": fit.reached,
        "missed": [item.target.title for item in fit.missed],
        "refusal": fit.refusal or None,
        "best": dict(fit.best),
        "level": LEVEL,
        "unknowns": {
            name: {"best": fit.best[name], "unit": unit_of(name)}
            | ({} if found is None else _interval(found.intervals[name]))
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
        "misfit": _finite(fit.misfit(False)),
        "hold_out_misfit": _finite(fit.misfit(True)),
        "seed": fit.specification.seed,
        "simulations": fit.simulations + fit.kept,
        "versions": fit_versions(),
        "specification": fit.specification.content(),
    }


def _interval(interval: Interval) -> dict[str, Any]:
    return dataclasses.asdict(interval) | {"identified": interval.identified}


def _comparison(item: Comparison) -> dict[str, Any]:
    return {
        "target": item.target.title,
        "source": item.target.source,
        "unit": item.target.measure.unit,
        "value": item.target.value,
        "tolerance": item.target.error(0.0),
        "hold_out": item.target.hold_out,
        "model": _finite(item.mean),
        "standard_error": _finite(item.standard_error),
        "spread": _finite(item.spread),
        "ratio": _finite(item.ratio),
        "deviation": _finite(item.deviation),
        "reached": item.reached,
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _posterior(fit: Fit) -> bytes:
    """Return equally probable points of the posterior as CSV."""
    text = io.StringIO()
    columns = np.column_stack(list(fit.samples.values()))
    heading = ",".join(fit.samples)
    np.savetxt(text, columns, fmt="%.9g", delimiter=",", header=heading, comments="")
    return text.getvalue().encode()


def _page(fit: Fit, command: str) -> str:
    found = fit.found
    return render_page(
        _BODY,
        "Fit of a drill",
        command=command,
        seed=fit.specification.seed,
        verdict=_verdict(fit),
        refusal=fit.refusal,
        missed=[item.miss for item in fit.missed],
        runs=fit.simulations + fit.kept,
        percent=PERCENT,
        heading=("parameter", "best point", f"{PERCENT} interval", "width", "remarks")[
            : 5 if found else 2
        ],
        unknowns=[_unknown(fit, name) for name in fit.specification.unknowns],
        choices=[(choices, f"{share:.3f}") for choices, share in fit.choices],
        ridges=[str(ridge) for ridge in found.ridges] if found else [],
        corner=_corner(fit),
        target_plot=target_plot(fit),
        best_runs=BEST_RUNS,
        misfit=fit.misfit_text,
    )


def _corner(fit: Fit) -> str:
    if fit.found is None:
        return ""
    rows, text = corner_rows(fit, fit.found), corner_text(fit, fit.found)
    return corner("Posterior of the unknown parameters", rows, text)


def _verdict(fit: Fit) -> str:
    """Return in one sentence whether the model reaches the targets."""
    used = sum(not item.target.hold_out for item in fit.comparisons)
    if fit.reached:
        return f"The model reaches all {used} targets that the fit used."
    return f"Not met: the model does not reach {len(fit.missed)} of {used} targets."


def _unknown(fit: Fit, name: str) -> tuple[str, ...]:
    shown = unknown_quantity(fit, name)
    best = (name, shown.text(fit.best[name]))
    if fit.found is None:
        return best
    interval = fit.found.intervals[name]
    ends = f"{shown.text(interval.low, unit=False)} to {shown.text(interval.high)}"
    return (*best, ends, f"{interval.width:.2f}", "; ".join(interval.remarks))


def _write(path: Path, content: bytes) -> None:
    with whole_file(path) as unfinished:
        unfinished.write_bytes(content)
