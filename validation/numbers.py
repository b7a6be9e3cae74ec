"""Numbers that the paper states, and the metric of a run of the model to compare with each."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from tqdm.contrib.concurrent import thread_map

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.contact import single_contact
from rpud_sim.scripting.runs import DrillRun
from rpud_sim.simulation import Parameters, to_settings
from rpud_sim.simulation.plan import Beginning, Plan

CONTACT_SPEED = 5.0  # Fig. 12 [m/s]

_SHORT = 0.6  # window of Figs. 3, 8, 10, 11 and 13 [s]
_LONG = 5.0  # window of Fig. 5, and by assumption of Fig. 14 [s]
_SAMPLE_RATE = 5000  # of displacements; these motions are slower than 100 Hz [Hz]


@dataclasses.dataclass(frozen=True)
class Number:
    """Number of the paper."""

    label: str  # figure of the paper, and which of its numbers
    regime: str  # of the model's run
    metric: str  # of that run, or what ``value_in`` makes of it
    window: float  # from the start of the run [s]
    paper: float  # its value, in SI units
    unit: str
    statement: str  # meaning, in the paper's words where they matter

    def value_in(self, run: DrillRun) -> float:
        """Return its counterpart in a run over its window; NaN where there is none."""
        kind, _, detail = self.metric.partition(" ")
        if kind == "contact":  # of one collision, for which nothing is simulated
            beginning = run.plan.beginning.settings.configuration
            return float(getattr(single_contact(beginning.parameters, CONTACT_SPEED), detail))
        if kind == "quantile":
            forces = run["contact_force"]["peak_force"]
            return float(np.quantile(forces, float(detail))) if len(forces) else np.nan
        if kind == "greatest":
            return float(np.abs(run.waveform(_SAMPLE_RATE)[detail]).max())
        if kind == "energy":
            return float(run.metrics["kinetic_energy_rate"] * run.duration)
        value = run.metrics[kind]
        return np.nan if value is None else float(value)


KINETIC_ENERGY = Number(
    "Fig. 13", "drilling", "energy", _SHORT, 12.4, "J", "energy brought to the tool in 0.6 s"
)
FIGURE_12 = (
    Number("Fig. 12 force", "drilling", "contact peak_force", _SHORT, 1650.0, "N",
           "contact force of one collision at 5 m/s"),
    Number("Fig. 12 displacement", "drilling", "contact peak_displacement", _SHORT, 42e-6, "m",
           "displacement of one collision at 5 m/s"),
)  # fmt: skip
SIMULATED = (
    Number("Fig. 3", "free", "drill_tool_impact_rate", _SHORT, 260 / 0.6, "1/s",
           "260 impacts in 0.6 s, “nearly 430 Hz”"),
    Number("Fig. 5", "free", "reacting_force_mean", _LONG, 5.8, "N", "mean reacting force"),
    Number("Fig. 8", "drilling", "drill_tool_impact_rate", _SHORT, 282 / 0.6, "1/s",
           "282 impacts in 0.6 s, “nearly 470 Hz”"),
    KINETIC_ENERGY,
    Number("Fig. 14", "drilling", "reacting_force_mean", _LONG, 14.0, "N", "mean reacting force"),
    Number("Fig. 10", "drilling", "contact_force_max", _SHORT, 2600.0, "N",
           "greatest contact force"),
    Number("Fig. 11 low", "drilling", "quantile 0.05", _SHORT, 400.0, "N",
           "“most” forces are above (5 % quantile)"),
    Number("Fig. 11 high", "drilling", "quantile 0.95", _SHORT, 2200.0, "N",
           "“most” forces are below (95 % quantile)"),
    *FIGURE_12,
)  # fmt: skip
MEASURED = (
    Number("Fig. 20 nodal plane", "free", "greatest nodal_plane_position", _SHORT, 2.6e-3, "m",
           "measured amplitude; greatest displacement in 0.6 s"),
    Number("Fig. 20 drill tool", "free", "greatest drill_tool_displacement", _SHORT, 14e-3, "m",
           "measured amplitude; greatest displacement in 0.6 s"),
    Number("Fig. 21", "free", "reacting_force_mean", _LONG, 5.2, "N",
           "measured mean reacting force"),
)  # fmt: skip
NUMBERS = (*SIMULATED, *MEASURED)


def runs_of(drill: Parameters, phase: float, *durations: float) -> list[DrillRun]:
    """Return runs from an initial phase [cycles], each as long as one of the durations [s]."""
    plan = Plan(Beginning(to_settings(dataclasses.asdict(drill)), phase))
    return [DrillRun(plan, round(duration * SECOND)) for duration in durations]


def values_of(drill: Parameters, phase: float, numbers: Sequence[Number]) -> list[float]:
    """Return the counterparts of numbers in the runs from an initial phase."""
    windows = sorted({number.window for number in numbers})
    runs = dict(zip(windows, runs_of(drill, phase, *windows), strict=True))
    return [number.value_in(runs[number.window]) for number in numbers]


def gather(function: Callable[..., Any], jobs: Iterable[tuple[Any, ...]], title: str) -> list[Any]:
    """Return the results of jobs, on a thread for each core: the kernels need no GIL."""
    cores = len(os.sched_getaffinity(0))
    jobs, bar = list(jobs), {"desc": title, "leave": False, "disable": None}
    results: list[Any] = thread_map(lambda job: function(*job), jobs, max_workers=cores, **bar)
    return results


def plain(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, without an exponent if it is moderate."""
    if value != 0.0 and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    return np.format_float_positional(value, digits, fractional=False, trim="-")


def show(value: float, unit: str) -> str:
    """Return a quantity in a fitting unit, such as 42 µm for 4.2e-5 m."""
    if unit == "m":
        return f"{plain(1e6 * value)} µm" if value < 1e-3 else f"{plain(1e3 * value)} mm"
    return f"{plain(1e6 * value)} µs" if unit == "s" else f"{plain(value)} {unit}".rstrip()
