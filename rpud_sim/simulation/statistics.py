"""Statistics of a run, accumulated block by block."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from rpud_sim.drilling.rotor import RotorWork
from rpud_sim.foundation.time import SECOND, split_fraction
from rpud_sim.model.elementary import power
from rpud_sim.model.energy import DRILL_TOOL_DAMPER, IMPACTS, RELEASE
from rpud_sim.model.tally import (
    CLASSES,
    CLASSES_PER_DECADE,
    LEAST_FORCE,
    PART_ROOM,
    QUANTILE,
    TALLY,
    add_block,
    class_at,
    empty_tallies,
)
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount, absorbed, sum_accounts

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


def force_of(number: int) -> float | None:
    """Return the contact force of a class [N]; None for a negative number."""
    if number < 0:
        return None
    decades, part = divmod(number, CLASSES_PER_DECADE)
    return float(LEAST_FORCE * float(f"1e{decades}") * power(10.0, part / CLASSES_PER_DECADE))


def figures_of(tally: np.void, duration: float, quantile: int) -> dict[str, float | int | None]:
    """Return duration and ``FIGURES`` in SI units; None if there is nothing to average.

    ``quantile`` is the class of the 99 % quantile of the contact force, -1 for none.
    """
    totals = dict(zip(TALLY.names or (), tally.item(), strict=True))
    account, count = tally["account"].tolist(), totals["impacts"]

    def rate(total: float) -> float | None:
        return total / duration if duration > 0.0 else None

    def mean(total: float) -> float | None:
        return total / count if count else None

    return {
        "duration": duration,
        "events": totals["events"],
        "drill_tool_impact_rate": rate(count),
        "actuator_impact_rate": rate(totals["actuator_impacts"]),
        "impact_velocity_mean": mean(totals["impact_velocity"]),
        "contact_force_mean": mean(totals["contact_force"]),
        "contact_force_p99": force_of(quantile),
        "contact_force_max": totals["contact_force_max"] if count else None,
        "contact_duration_mean": mean(totals["contact_duration"]),
        "squeezed_impact_rate": rate(totals["squeezed"]),
        "kinetic_energy_rate": rate(totals["energy"]),
        "energy_transferred_rate": rate(totals["energy_transferred"]),
        "energy_absorbed_rate": rate(
            absorbed(account[IMPACTS], account[RELEASE], account[DRILL_TOOL_DAMPER])
        ),
        "reacting_force_mean": rate(totals["reacting_impulse"]),
    }


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
        self.begun = False  # whether anything was added, read-only
        self._duration = 0
        self._electrical = 0.0
        # of the blocks so far, read-only; None without a feed
        self.feed: FeedAccount | None = None
        # of the rotor from time zero to the last block, read-only; None without rotation
        self.rotation: RotorWork | None = None
        self._tally = empty_tallies(1)
        self._classes = np.zeros(CLASSES, np.int64)
        self._part = np.zeros(PART_ROOM)

    @property
    def duration(self) -> float:
        """Simulated time of the blocks so far [s]."""
        return self._duration / SECOND

    @property
    def account(self) -> EnergyAccount:
        """The energy account of the blocks so far."""
        return EnergyAccount.from_tally(self._tally[0], self._electrical)

    def add(self, block: Block) -> None:
        """Add what happened in a block."""
        # The first segment began before this block, except at time zero.
        counts = block.start == 0 and not self.begun
        self.note_part(block.start, block.end, block.electrical_energy)
        self.feed = sum_accounts((self.feed, block.feed))
        rotor = block.process.rotation
        self.rotation = rotor.work if rotor else None
        add_block(
            block.rpud,
            block.covering,
            block.impacts,
            split_fraction(block.start),
            split_fraction(block.end),
            counts,
            self._tally,
            self._classes,
            self._part,
        )

    @property
    def sums(self) -> tuple[np.ndarray, np.ndarray]:
        """One ``TALLY`` and the classes of contact forces, for a kernel to add to."""
        return self._tally, self._classes

    def note_part(self, start: int, end: int, electrical_energy: float) -> None:
        """Note a part of a run that is, or will be, in the sums.

        electrical_energy: that the actuator drew in it [J]; NaN where its model has no power.
        """
        self.begun = True
        self._duration += end - start
        self._electrical += electrical_energy

    def merge(self, other: Statistics) -> None:
        """Add the sums of other statistics."""
        self.begun = self.begun or other.begun
        self._duration += other._duration
        self._electrical += other._electrical
        self.feed = sum_accounts((self.feed, other.feed))
        one, another = self._tally, other._tally
        least, most = int(another["lowest_class"][0]), int(another["highest_class"][0])
        for name in TALLY.names or ():
            combine = {"lowest_class": np.minimum, "highest_class": np.maximum}.get(name, np.add)
            one[name] = (np.maximum if name == "contact_force_max" else combine)(
                one[name], another[name]
            )
        if least <= most:
            self._classes[least : most + 1] += other._classes[least : most + 1]

    def figures(self) -> dict[str, float | int | None]:
        """Return duration and ``FIGURES`` in SI units; None if there is nothing to average."""
        quantile = class_at(self._tally, self._classes, QUANTILE)
        return figures_of(self._tally[0], self.duration, quantile)
