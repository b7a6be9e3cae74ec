"""Trends of Figs. 15-18: four parameters, four outputs, and a verdict on each.

Each point is an ensemble of long runs over different initial phases, so that all are independent.
A trend is tested with Kendall's tau between the parameter and the members' outputs (with ties: the
Jonckheere-Terpstra test); Holm's method corrects the p-values of all trends together. A trend that
is significant but changes the output by less than ``LITTLE`` from end to end counts as flat: the
paper's "little effect".
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy import stats

from rpud_sim.simulation import Parameters
from validation.numbers import gather, runs_of

VALUES = {
    "actuator_restitution": np.linspace(0.5, 1.0, 9),
    "free_mass": np.linspace(2e-3, 10e-3, 9),
    "rpud_damping_ratio": np.linspace(0.1, 0.9, 9),
    "weight_on_bit": np.linspace(0.0, 40.0, 9),
}
_IMPACTS = "drill_tool_impact_rate"
OUTPUTS = ("contact_force_mean", _IMPACTS, "kinetic_energy_rate", "reacting_force_mean")

SETTLING = 1.0  # simulated before statistics begin [s]
SIGNIFICANCE, LITTLE = 0.05, 0.05

# The paper's claims about each study, in the order of OUTPUTS. Section IV swaps the letters of the
# panels (c) and (d) of Fig. 17.
_HARDER_BLOWS: dict[str, tuple[str, ...]] = {
    "section": ("rises", "falls", "rises", "rises"),
    "abstract": ("rises", "", "rises", ""),
    "conclusion": ("rises", "", "rises", "rises"),
}
CLAIMS: dict[str, dict[str, tuple[str, ...]]] = {
    "actuator_restitution": _HARDER_BLOWS,
    "free_mass": _HARDER_BLOWS,
    "rpud_damping_ratio": {
        "section": ("flat", "rises", "rises", "falls"),
        "abstract": ("falls", "", "falls", ""),
        "conclusion": ("rises", "", "rises", "falls"),
    },
    "weight_on_bit": {**_HARDER_BLOWS, "section": ("flat", "rises", "rises", "rises")},
}


@dataclasses.dataclass(frozen=True)
class Study:
    """Study of one parameter's effect on all outputs."""

    parameter: str  # its name
    values: np.ndarray  # of the parameter, shape (n,), SI units
    members: dict[str, np.ndarray]  # outputs at each value, by output, shape (n, members)

    def slope(self, output: str) -> tuple[float, float]:
        """Return slope of an output over the parameter, and half its 95 % interval."""
        members = self.members[output]
        line = stats.linregress(np.repeat(self.values, members.shape[1]), members.ravel())
        return float(line.slope), float(stats.t.ppf(0.975, members.size - 2) * line.stderr)


@dataclasses.dataclass(frozen=True)
class Trend:
    """Verdict on one output of one study."""

    parameter: str  # that is varied
    output: str  # that depends on it
    verdict: str  # rises, falls or flat
    p_value: float  # corrected by Holm's method over all trends
    change: float  # from the first to the last value, as a share of the mean
    change_interval: float  # half its 95 % interval


def run_studies(base: Parameters, members: int, duration: float, seed: int) -> list[Study]:
    """Return the four studies of a drill, with runs of a duration after they have settled [s]."""
    random = np.random.default_rng(seed)
    jobs = [
        (base.replace(**{name: float(value)}), float(phase), duration)
        for name, values in VALUES.items()
        for value in values
        for phase in random.random(members)
    ]
    table = np.array(gather(_outputs, jobs, "studies")).reshape(len(VALUES), -1, members, 4)
    return [
        Study(name, values, {output: own[:, :, i] for i, output in enumerate(OUTPUTS)})
        for (name, values), own in zip(VALUES.items(), table, strict=True)
    ]


def _outputs(drill: Parameters, phase: float, duration: float) -> list[float]:
    """Return the outputs of a run after it has settled: the whole run less its beginning."""
    times = SETTLING, SETTLING + duration
    early, late = (run.metrics for run in runs_of(drill, phase, *times))

    def after(name: str, *weights: float) -> float:
        total = weights[1] * late[name] - weights[0] * (early[name] or 0.0)
        return float(total / (weights[1] - weights[0]))

    impacts = times[0] * early[_IMPACTS], times[1] * late[_IMPACTS]
    return [after(name, *(impacts if name == "contact_force_mean" else times)) for name in OUTPUTS]


def find_trends(studies: list[Study]) -> list[Trend]:
    """Return the verdict on each output of each study."""
    cases = [(study, output) for study in studies for output in OUTPUTS]
    rows = [(np.repeat(s.values, s.members[o].shape[1]), s.members[o].ravel()) for s, o in cases]
    values = [float(stats.kendalltau(*row).pvalue) for row in rows]
    # Holm: the smallest p-value counts once for each case, the next once less.
    order = np.argsort(values, kind="stable")
    scaled = np.array(values)[order] * np.arange(len(values), 0, -1)
    adjusted = np.empty(len(values))
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return [_verdict(*case, float(p)) for case, p in zip(cases, adjusted, strict=True)]


def _verdict(study: Study, output: str, p_value: float) -> Trend:
    members = study.members[output]
    mean, count = members.mean(axis=1), members.shape[1]
    half = members.std(axis=1, ddof=1) / np.sqrt(count) * stats.t.ppf(0.975, count - 1)
    scale = float(mean.mean())
    change = float(mean[-1] - mean[0]) / scale
    interval = float(np.hypot(half[-1], half[0])) / scale
    verdict = "flat"
    if p_value < SIGNIFICANCE and abs(change) > LITTLE:
        verdict = "rises" if change > 0.0 else "falls"
    return Trend(study.parameter, output, verdict, p_value, change, interval)
