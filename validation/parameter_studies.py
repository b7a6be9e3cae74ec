"""Parameter studies of Figs. 15-18: four parameters, four outputs, and a verdict on each trend.

Each point is an ensemble of long runs over initial phases. Each point has other phases, so that all
members are independent. A trend is tested with Kendall's tau between the parameter and the members'
outputs (with ties: the Jonckheere-Terpstra test); Holm's method corrects the p-values of all trends
together. A trend that is significant but changes the output by less than ``LITTLE`` from end
to end counts as flat: the paper's "little effect".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy import stats

from rpud_sim.simulation import Parameters
from rpud_sim.simulation.configuration import whole_configuration
from rpud_sim.studies.fit.measures import Measure, measure
from validation.jobs import Track, gather

VALUES = {
    "actuator_restitution": np.linspace(0.5, 1.0, 9),
    "free_mass": np.linspace(2e-3, 10e-3, 9),
    "rpud_damping_ratio": np.linspace(0.1, 0.9, 9),
    "weight_on_bit": np.linspace(0.0, 40.0, 9),
}
OUTPUTS = (
    "contact_force_mean",
    "drill_tool_impact_rate",
    "kinetic_energy_rate",
    "reacting_force_mean",
)

SETTLING = 1.0  # simulated before statistics begin [s]
SIGNIFICANCE = 0.05
LITTLE = 0.05

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

    def mean(self, output: str) -> np.ndarray:
        """Return the mean at each value, shape (n,)."""
        return self.members[output].mean(axis=1)

    def half_interval(self, output: str) -> np.ndarray:
        """Return half the 95 % interval of each mean by Student's t, shape (n,)."""
        members = self.members[output]
        count = members.shape[1]
        error = np.std(members, axis=1, ddof=1) / np.sqrt(count)
        return error * stats.t.ppf(0.975, count - 1)

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


def run_studies(
    base: Parameters, members: int, duration: float, seed: int, track: Track
) -> list[Study]:
    """Return the four studies of a drill.

    Args:
        members: number of runs at each point.
        duration: of each run, after it has settled [s].
    """
    random = np.random.default_rng(seed)
    measures = [Measure(output, SETTLING, SETTLING + duration) for output in OUTPUTS]
    jobs = [
        (base.replace(**{name: float(value)}), float(phase))
        for name, values in VALUES.items()
        for value in values
        for phase in random.random(members)
    ]
    rows = iter(
        gather(
            lambda job: measure(whole_configuration(job[0]), job[1], measures),
            jobs,
            "studies",
            track,
        )
    )
    studies = []
    for name, values in VALUES.items():
        table = np.array([[next(rows) for _ in range(members)] for _ in values])
        columns = {output: table[:, :, i] for i, output in enumerate(OUTPUTS)}
        studies.append(Study(name, values, columns))
    return studies


def find_trends(studies: list[Study]) -> list[Trend]:
    """Return the verdict on each output of each study."""
    cases = [(study, output) for study in studies for output in OUTPUTS]
    adjusted = _holm([_kendall(study, output) for study, output in cases])
    return [
        _verdict(study, output, p_value)
        for (study, output), p_value in zip(cases, adjusted, strict=True)
    ]


def _holm(chances: Sequence[float]) -> list[float]:
    """Return probabilities corrected for their number by Holm's step-down method."""
    corrected = [1.0] * len(chances)
    least = 0.0
    for rank, place in enumerate(sorted(range(len(chances)), key=chances.__getitem__)):
        least = max(least, min(1.0, (len(chances) - rank) * chances[place]))
        corrected[place] = least
    return corrected


def _kendall(study: Study, output: str) -> float:
    members = study.members[output]
    values = np.repeat(study.values, members.shape[1])
    return float(stats.kendalltau(values, members.ravel()).pvalue)


def _verdict(study: Study, output: str, p_value: float) -> Trend:
    mean, half = study.mean(output), study.half_interval(output)
    scale = float(mean.mean())
    change = float(mean[-1] - mean[0]) / scale
    interval = float(np.hypot(half[-1], half[0])) / scale
    verdict = "flat"
    if p_value < SIGNIFICANCE and abs(change) > LITTLE:
        verdict = "rises" if change > 0.0 else "falls"
    return Trend(study.parameter, output, verdict, p_value, change, interval)
