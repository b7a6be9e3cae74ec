"""Statistics of a run, accumulated block by block."""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from rpud_sim.foundation.time import SECOND, split_fraction
from rpud_sim.model.compile import compiled
from rpud_sim.model.segment import (
    EVENT_ACTUATOR_IMPACT,
    EVENT_DRILL_TOOL_IMPACT,
    EVENT_RELEASE,
    motion_at,
    nodal_plane_integral,
)
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.energy_account import EnergyAccount

# Names and units of the figures.
FIGURES = MappingProxyType(
    {
        "events": "",
        "drill_tool_impact_rate": "1/s",
        "actuator_impact_rate": "1/s",
        "impact_velocity_mean": "m/s",
        "contact_force_mean": "N",
        "contact_force_p99": "N",
        "contact_force_max": "N",
        "contact_duration_mean": "s",
        "squeezed_impact_rate": "1/s",
        "kinetic_energy_rate": "W",
        "energy_transferred_rate": "W",
        "energy_absorbed_rate": "W",
        "reacting_force_mean": "N",
    }
)


@compiled
def reacting_force_integral(segment, start, end):
    """Integral of R = W - k_1 u_np - c_1 v_np over a part of a segment [N s]."""
    u_start = motion_at(segment, start)[0]
    u_end = motion_at(segment, end)[0]
    position = nodal_plane_integral(segment, end) - nodal_plane_integral(segment, start)
    return (
        segment.weight_on_bit * (end - start)
        - segment.load_spring_rate * position
        - segment.load_spring_damping * (u_end - u_start)
    )


@compiled
def _sum_reacting_force(segments, seconds, fraction, from_seconds, from_fraction):
    total = 0.0
    for i in range(len(segments)):
        segment = segments[i]
        start = float(from_seconds - segment.start_seconds) + (
            from_fraction - segment.start_fraction
        )
        end = float(seconds - segment.start_seconds) + (fraction - segment.start_fraction)
        start = max(start, 0.0)
        end = min(end, segment.duration)
        if end > start:
            total += reacting_force_integral(segment, start, end)
    return total


def count_events(event: np.ndarray) -> tuple[int, int]:
    """Return the number of impacts and ends of contacts, and that of the actuator's impacts.

    Args:
        event: of the segments, shape (n,).
    """
    happened = EVENT_ACTUATOR_IMPACT | EVENT_DRILL_TOOL_IMPACT | EVENT_RELEASE
    return (
        int(np.count_nonzero(event & happened)),
        int(np.count_nonzero(event & EVENT_ACTUATOR_IMPACT)),
    )


class ForceClasses:
    """Counts of forces in logarithmic classes, for quantiles in bounded memory."""

    _LEAST, _GREATEST = 1e-6, 1e12  # [N]; what is beyond counts as these
    _PER_DECADE = 1000

    def __init__(self) -> None:
        decades = math.log10(self._GREATEST / self._LEAST)
        self._counts = np.zeros(round(decades * self._PER_DECADE) + 1, np.int64)

    def __add__(self, other: ForceClasses) -> ForceClasses:
        """Return the counts of both."""
        total = ForceClasses()
        total._counts = self._counts + other._counts
        return total

    def add(self, forces: np.ndarray) -> None:
        """Count forces [N]."""
        bounded = np.clip(forces, self._LEAST, self._GREATEST)
        classes = np.rint(np.log10(bounded / self._LEAST) * self._PER_DECADE).astype(np.intp)
        np.add.at(self._counts, classes, 1)

    def quantile(self, share: float) -> float | None:
        """Return the least force that a share of all do not exceed [N]; None if there are none."""
        reached = np.cumsum(self._counts)
        if not reached[-1]:
            return None
        number = int(np.searchsorted(reached, math.ceil(share * int(reached[-1]))))
        return float(self._LEAST * 10.0 ** (number / self._PER_DECADE))


class Statistics:
    """Sums over blocks, and the figures of a run from them.

    ``kinetic_energy_rate`` is the energy that arrives with the free mass,
    ``energy_transferred_rate`` what it does not take back with it, and ``energy_absorbed_rate``
    what drill tool and rock turn into heat and cracks. The 99 % quantile of the contact force is
    good to 0.12 %.

    The mean reacting force is the exact time average of the closed forms; impacts count when their
    contact ends.
    """

    def __init__(self) -> None:
        self._begun = False
        self._duration = 0
        self._events = 0
        self._actuator_impacts = 0
        self._impacts = 0
        self._impact_velocity = 0.0
        self._contact_force = 0.0
        self._contact_forces = ForceClasses()
        self._contact_force_max = -math.inf
        self._contact_duration = 0.0
        self._energy = 0.0
        self._energy_transferred = 0.0
        self._squeezed = 0
        self._account = EnergyAccount()
        self._reacting_impulse = 0.0

    @property
    def duration(self) -> float:
        """Simulated time of the blocks so far [s]."""
        return self._duration / SECOND

    @property
    def account(self) -> EnergyAccount:
        """The energy account of the blocks so far."""
        return self._account

    def add(self, block: Block) -> None:
        """Add what happened in a block."""
        # The first segment began before this block, except at time zero.
        event = block.covering["event"]
        if block.start > 0 or self._begun:
            event = event[1:]
        self._begun = True
        self._duration += block.end - block.start
        events, actuator_impacts = count_events(event)
        self._events += events
        self._actuator_impacts += actuator_impacts
        impacts = block.impacts
        if len(impacts):
            self._impacts += len(impacts)
            self._impact_velocity += float(impacts["impact_velocity"].sum())
            self._contact_force += float(impacts["peak_force"].sum())
            self._contact_force_max = max(
                self._contact_force_max, float(impacts["peak_force"].max())
            )
            self._contact_duration += float(impacts["contact_duration"].sum())
            self._energy += float(impacts["energy"].sum())
            self._energy_transferred += float(impacts["energy_transferred"].sum())
            self._squeezed += int(np.count_nonzero(impacts["squeezed"]))
            self._contact_forces.add(impacts["peak_force"])
        self._account += EnergyAccount.of(block)
        self._reacting_impulse += _reacting_impulse(block)

    def merge(self, other: Statistics) -> None:
        """Add the sums of other statistics."""
        for name, value in vars(other).items():
            if name == "_contact_force_max":
                self._contact_force_max = max(self._contact_force_max, value)
            else:
                setattr(self, name, getattr(self, name) + value)

    def figures(self) -> dict[str, float | int | None]:
        """Return duration and ``FIGURES`` in SI units; None if there is nothing to average."""
        duration = self.duration
        count = self._impacts

        def rate(total: float) -> float | None:
            return total / duration if duration > 0.0 else None

        def mean(total: float) -> float | None:
            return total / count if count else None

        return {
            "duration": duration,
            "events": self._events,
            "drill_tool_impact_rate": rate(count),
            "actuator_impact_rate": rate(self._actuator_impacts),
            "impact_velocity_mean": mean(self._impact_velocity),
            "contact_force_mean": mean(self._contact_force),
            "contact_force_p99": self._contact_forces.quantile(0.99),
            "contact_force_max": self._contact_force_max if count else None,
            "contact_duration_mean": mean(self._contact_duration),
            "squeezed_impact_rate": rate(self._squeezed),
            "kinetic_energy_rate": rate(self._energy),
            "energy_transferred_rate": rate(self._energy_transferred),
            "energy_absorbed_rate": rate(self._account.absorbed),
            "reacting_force_mean": rate(self._reacting_impulse),
        }


def _reacting_impulse(block: Block) -> float:
    return float(
        _sum_reacting_force(
            block.covering, *split_fraction(block.end), *split_fraction(block.start)
        )
    )
