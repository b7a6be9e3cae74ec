"""Search for readings: a quasi-random design in A, W and e_1 for each discrete choice.

The design (Sobol's sequence) is one for all discrete choices. Around the best point of each tool in
the rock it is refined in smaller boxes. A search compares thousands of readings with ten numbers by
a few members each, so the best misfit is optimistic: the readings found run again, with other
initial phases, before they are scored.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Sequence

import numpy as np
from scipy.stats import qmc

from rpud_sim.simulation import Parameters
from rpud_sim.studies.reproduction.choices import (
    COUNTS,
    ENERGIES,
    PRINTED_TOOL_MASS,
    SHAPE_MASS,
    TOOLS,
    Before,
    Reading,
    Rock,
)
from rpud_sim.studies.reproduction.jobs import Track, gather
from rpud_sim.studies.reproduction.paper_numbers import SIMULATED
from rpud_sim.studies.reproduction.scores import columns_of, root_mean_square_log
from rpud_sim.studies.reproduction.windows import LONG, Members, run_windows

GRAVITIES = (9.81, 0.0)  # [m/s^2]
TOOL_MASSES = (PRINTED_TOOL_MASS, SHAPE_MASS)  # before drilling [kg]

# Continuous choices: least and greatest value, and the step to which a found one is rounded.
AMPLITUDES = (10e-6, 40e-6, 0.1e-6)  # [m]
WEIGHTS = (0.0, 16.0, 0.1)  # in the rock [N]
RESTITUTIONS = (0.4, 1.0, 0.01)

_REFINEMENTS = (0.25, 0.1)  # sides of the boxes, as shares of the ranges
_REFINED_FAMILIES = 6  # those of the least misfit; the rest is too far off for a refinement

_LONG = 2.0  # window of the mean reacting force in a search [s]

# The paper's runs begin at phase zero, eq. (1); members begin at most this far from it [cycles].
PHASE_SPREAD = 0.1

_BEFORE_NUMBERS = tuple(number for number in SIMULATED if number.regime == "free")
_ROCK_NUMBERS = tuple(number for number in SIMULATED if number.regime != "free")

Point = tuple[float, float, float]  # A [m], W [N], e_1


@dataclasses.dataclass(frozen=True)
class Candidate:
    """Choices that a search compares: before drilling, in the rock, or both."""

    before: Before | None  # choices before drilling; None if they do not matter
    rock: Rock | None  # choices in the rock; None if they do not matter

    def at(self, point: Point) -> Candidate:
        """Return the same discrete choices at another point."""
        amplitude, weight, restitution = point
        return Candidate(
            self.before
            and dataclasses.replace(
                self.before, vibration_amplitude=amplitude, actuator_restitution=restitution
            ),
            self.rock
            and dataclasses.replace(
                self.rock,
                vibration_amplitude=amplitude,
                actuator_restitution=restitution,
                weight_on_bit=weight,
            ),
        )

    @property
    def point(self) -> Point:
        """Its continuous choices; W is zero before drilling."""
        part = self.rock or self.before
        assert part is not None
        weight = self.rock.weight_on_bit if self.rock else 0.0
        return part.vibration_amplitude, weight, part.actuator_restitution

    def drills(self) -> list[Parameters]:
        """Return the drills that have to run."""
        return [part.parameters() for part in (self.before, self.rock) if part]


@dataclasses.dataclass(frozen=True)
class Search:
    """Result of a search."""

    readings: tuple[Reading, ...]  # the best of each tool, with one set of choices and with two
    # by tool, the least misfit of the numbers in the rock at each point of the design, over
    # all other choices: points (n, 3) and misfits (n,)
    ridges: dict[str, tuple[np.ndarray, np.ndarray]]
    compared: int  # number of sets of choices that were compared
    runs: int  # number of runs


def simulate(
    drills: Iterable[Parameters],
    members: int,
    seed: int,
    title: str,
    track: Track,
    long: float = LONG,
) -> dict[Parameters, Members]:
    """Run the paper's windows of every drill, each with initial phases of its own.

    Args:
        members: runs of each.
        long: window of the mean reacting force [s].
    """
    unique = list(dict.fromkeys(drills))
    random = np.random.default_rng(seed)
    phases = PHASE_SPREAD * random.uniform(-1.0, 1.0, (len(unique), members))
    jobs = list(zip(unique, phases, strict=True))
    return dict(
        zip(unique, gather(lambda job: run_windows(*job, long), jobs, title, track), strict=True)
    )


def design(count: int, seed: int, centre: Point | None = None, side: float = 1.0) -> list[Point]:
    """Return points of Sobol's sequence in a box.

    Args:
        centre: of the box; of the whole range without one. What lies outside is moved inside.
        side: of the box, as a share of each range.
    """
    bounds = np.array([AMPLITUDES, WEIGHTS, RESTITUTIONS])
    low, high, step = bounds.T
    middle = 0.5 * (low + high) if centre is None else np.array(centre)
    half = 0.5 * side * (high - low)
    low, high = np.maximum(low, middle - half), np.minimum(high, middle + half)
    points = qmc.scale(qmc.Sobol(3, seed=seed).random(count), low, high)
    digits = np.rint(-np.log10(step)).astype(int).tolist()
    return [
        (round(amplitude, digits[0]), round(weight, digits[1]), round(restitution, digits[2]))
        for amplitude, weight, restitution in points.tolist()
    ]


def search(points: int, refined: int, members: int, seed: int, track: Track) -> Search:
    """Return the best readings of every tool.

    Args:
        points: of the design, a power of two.
        refined: points of each refinement, a power of two.
        members: runs per drill.
    """
    finder = _Finder(members, seed, track)
    wide = design(points, seed)
    families = _families()
    finder.run(
        [item.at(point) for family in families.values() for item in family for point in wide]
    )
    best = {name: finder.best_of(family, wide) for name, family in families.items()}
    ranked = sorted(best, key=lambda name: finder.misfit(best[name]))
    for number, side in enumerate(_REFINEMENTS, 1):
        boxes = {
            name: design(refined, seed + number, best[name].point, side)
            for name in ranked[:_REFINED_FAMILIES]
        }
        finder.run([best[name].at(point) for name, box in boxes.items() for point in box])
        for name, box in boxes.items():
            best[name] = finder.better(best[name], [best[name].at(point) for point in box])
    ridges = {}
    for tool in TOOLS:
        family = families[f"{tool} / rock"]
        misfits = [finder.misfit(finder.best_of(family, [point])) for point in wide]
        ridges[tool] = np.array(wide), np.array(misfits)
    return Search(tuple(_readings(best)), ridges, finder.compared, finder.runs)


def _families() -> dict[str, list[Candidate]]:
    """Return the discrete choices that compete with each other, by name."""
    befores = [
        Before(gravity=gravity, drill_tool_mass=mass, count=count)
        for gravity, mass, count in itertools.product(GRAVITIES, TOOL_MASSES, COUNTS)
    ]
    families = {
        f"before / {count}": [Candidate(item, None) for item in befores if item.count == count]
        for count in COUNTS
    }
    for tool in TOOLS:
        rocks = [
            Rock(gravity=gravity, tool=tool, energy=energy, count=count)
            for gravity, energy, count in itertools.product(GRAVITIES, ENERGIES, COUNTS)
        ]
        families[f"{tool} / rock"] = [Candidate(None, rock) for rock in rocks]
        families[f"{tool} / one"] = [
            Candidate(before, rock)
            for before, rock in itertools.product(befores, rocks)
            if (before.gravity, before.count) == (rock.gravity, rock.count)
        ]
    return families


def _readings(best: dict[str, Candidate]) -> Iterable[Reading]:
    for tool in TOOLS:
        one, rock = best[f"{tool} / one"], best[f"{tool} / rock"].rock
        assert one.before is not None
        assert one.rock is not None
        assert rock is not None
        before = best[f"before / {rock.count}"].before
        assert before is not None
        yield Reading(f"found, {tool}", before, rock)
        yield Reading(f"found with one A and e_1, {tool}", one.before, one.rock)


class _Finder:
    """Runs that are known so far, and misfits from them."""

    def __init__(self, members: int, seed: int, track: Track) -> None:
        self._members = members
        self._seed = seed
        self._track = track
        self._windows: dict[Parameters, Members] = {}
        self._misfits: dict[Before | Rock, float] = {}

    @property
    def compared(self) -> int:
        """Number of sets of choices of one regime with a misfit."""
        return len(self._misfits)

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self._windows) * self._members

    def run(self, candidates: Sequence[Candidate]) -> None:
        """Run the drills of candidates that are not known yet."""
        drills = [drill for item in candidates for drill in item.drills()]
        unknown = [drill for drill in dict.fromkeys(drills) if drill not in self._windows]
        self._seed += 1
        self._windows |= simulate(unknown, self._members, self._seed, "search", self._track, _LONG)

    def best_of(self, family: Sequence[Candidate], points: Sequence[Point]) -> Candidate:
        """Return the candidate of the least misfit, over discrete choices and points."""
        return min((item.at(point) for point in points for item in family), key=self.misfit)

    def better(self, best: Candidate, others: Sequence[Candidate]) -> Candidate:
        """Return the candidate of the least misfit."""
        return min((best, *others), key=self.misfit)

    def misfit(self, candidate: Candidate) -> float:
        """Return the misfit over the simulated numbers of the candidate's regimes."""
        before, rock = candidate.before, candidate.rock
        parts = []
        if before:
            parts.append((len(_BEFORE_NUMBERS), self._part(before)))
        if rock:
            parts.append((len(_ROCK_NUMBERS), self._part(rock)))
        weight = sum(count for count, _ in parts)
        return float(np.sqrt(sum(count * part**2 for count, part in parts) / weight))

    def _part(self, part: Before | Rock) -> float:
        if part not in self._misfits:
            numbers = _BEFORE_NUMBERS if isinstance(part, Before) else _ROCK_NUMBERS
            before = part if isinstance(part, Before) else Before()
            rock = part if isinstance(part, Rock) else Rock()
            columns = columns_of(numbers, Reading("", before, rock), self._windows)
            ratios = [columns[number.key].mean() / number.paper for number in numbers]
            value = root_mean_square_log(ratios)
            self._misfits[part] = value if np.isfinite(value) else np.inf
        return self._misfits[part]
