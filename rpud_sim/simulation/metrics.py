"""Metrics and energies of a run, accumulated block by block."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from itertools import chain, islice
from types import MappingProxyType
from typing import Any

import numpy as np

from rpud_sim.drilling.rotor import RotorWork
from rpud_sim.foundation.shown_quantities import METRIC_UNITS
from rpud_sim.foundation.time import SECOND, split_fraction
from rpud_sim.model.elementary import power
from rpud_sim.model.energy import TERMS
from rpud_sim.model.segment import SEGMENT, join_records
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
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount, sum_accounts

# Names and units of the metrics of every run.
METRICS = MappingProxyType(
    {name: unit for name, unit in METRIC_UNITS.items() if name not in ("depth", "penetration_rate")}
)
Values = dict[str, float | int | None]


def _values_of(tally: np.void, duration: float, quantile: int) -> Values:
    """Return duration and ``METRICS`` in SI units; None if there is nothing to average.

    ``quantile`` is the class of the 99 % quantile of the contact force, -1 for none.
    """

    def force_of(number: int) -> float:
        decades, part = divmod(number, CLASSES_PER_DECADE)
        return float(LEAST_FORCE * float(f"1e{decades}") * power(10.0, part / CLASSES_PER_DECADE))

    totals = dict(zip(TALLY.names or (), tally.item(), strict=True))
    count = totals["impacts"]

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
        "contact_force_p99": force_of(quantile) if quantile >= 0 else None,
        "contact_force_max": totals["contact_force_max"] if count else None,
        "contact_duration_mean": mean(totals["contact_duration"]),
        "squeezed_impact_rate": rate(totals["squeezed"]),
        "kinetic_energy_rate": rate(totals["energy"]),
        "energy_transferred_rate": rate(totals["energy_transferred"]),
        "energy_absorbed_rate": rate(account_of_tally(tally).absorbed),
        "reacting_force_mean": rate(totals["reacting_impulse"]),
    }


class Metrics:
    """Sums over blocks, and the metrics of a run from them.

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
        # account of the blocks so far, read-only; None without a feed
        self.feed: FeedAccount | None = None
        # work of the rotor from time zero to the last block, read-only; None without rotation
        self.rotation: RotorWork | None = None
        self._depth = math.nan  # depth of the hole at the last block; NaN without a rock model
        self._tally = empty_tallies(1)
        self._classes = np.zeros(CLASSES, np.int64)
        self._part = np.zeros(PART_ROOM)

    @property
    def duration(self) -> float:
        return self._duration / SECOND

    @property
    def account(self) -> EnergyAccount:
        return account_of_tally(self._tally[0], self._electrical)

    def add(self, block: Block) -> None:
        """Add what happened in a block."""
        # The first segment began before this block, except at time zero.
        counts = block.start == 0 and not self.begun
        self.begun = True
        self._duration += block.end - block.start
        self._electrical += block.electrical_energy
        self.feed = sum_accounts((self.feed, block.feed))
        rotor = block.process.rotation
        self.rotation = rotor.work if rotor else None
        self._depth = block.depth
        times = split_fraction(block.start), split_fraction(block.end)
        sums = (self._tally, self._classes, self._part)
        add_block(block.rpud, block.covering, block.impacts, *times, counts, *sums)

    def merge(self, other: Metrics) -> None:
        self.begun = self.begun or other.begun
        self._duration += other._duration
        self._electrical += other._electrical
        self.feed = sum_accounts((self.feed, other.feed))
        least, most = np.minimum, np.maximum
        extremes = {"lowest_class": least, "highest_class": most, "contact_force_max": most}
        for name in TALLY.names or ():
            self._tally[name] = extremes.get(name, np.add)(self._tally[name], other._tally[name])
        self._classes += other._classes

    def values(self) -> Values:
        """Return the metrics of the blocks so far, in SI units by name."""
        quantile = class_at(self._tally, self._classes, QUANTILE)
        return _values_of(self._tally[0], self.duration, quantile)

    def to_dict(self) -> dict[str, Any]:
        """Return the metrics and energy accounts of a run from time zero on, ready for JSON.

        With a rock model they have the depth at the end [m] and the mean penetration rate [m/s].
        """
        account = self.account
        found: dict[str, Any] = self.values()
        if math.isfinite(self._depth):
            found["depth"] = self._depth
            found["penetration_rate"] = self._depth / self.duration
        found["energy_account"] = account.to_dict()
        if self.feed is not None:
            found["feed_account"] = self.feed.to_dict(account.weight_on_bit_work)
        if self.rotation is not None:
            found["rotation_account"] = dataclasses.asdict(self.rotation)
        return found


def account_of_tally(tally: np.void, electrical: float = 0.0) -> EnergyAccount:
    """Return the account of a tally, with the electrical energy [J]."""
    terms = zip(TERMS, tally["account"].tolist(), strict=True)
    return EnergyAccount(**dict(terms), electrical=electrical)


def account_of(block: Block) -> EnergyAccount:
    metrics = Metrics()
    metrics.add(block)
    return metrics.account


class RecentEnergy:
    """Mean powers over the blocks of the last second of simulation time."""

    def __init__(self, has_feed: bool = False) -> None:
        self._no_feed = FeedAccount(*[0.0 if has_feed else math.nan] * len(vars(FeedAccount())))
        self._blocks: deque[Block] = deque()

    def add(self, block: Block) -> None:
        self._blocks.append(block)
        while self._blocks[0].end <= block.end - SECOND:
            self._blocks.popleft()

    def powers(self) -> dict[str, float]:
        """Return mean powers by their name in ``rpud_msgs/Power`` [W]; zero before the start."""
        total, feed, seconds = self._last_second()
        energies = {
            "actuator_power": total.actuator_work,
            "weight_power": total.weight_on_bit_work + total.gravity_work,
            "change_power": total.changes,
            "load_damper_power": total.load_damper,
            "collision_power": total.actuator_collisions + total.contact_resolution,
            "absorbed_power": total.absorbed,
            "stored_power": total.stored,
            "weight_on_bit_power": total.weight_on_bit_work,
            "feed_power": feed.work,
            "mount_power": feed.mount_work,
            "coupling_power": feed.coupling,
        }
        # A quotient of NaN may have another sign on another processor.
        return {
            name: math.nan if math.isnan(energy) else energy / seconds
            for name, energy in energies.items()
        }

    def _last_second(self) -> tuple[EnergyAccount, FeedAccount, float]:
        """Return the accounts of the last second, and its length [s]."""
        if not self._blocks:
            return EnergyAccount(), self._no_feed, math.inf
        first, *others = self._blocks
        last = self._blocks[-1]
        # Parts of the first block that ended before.
        late = int(np.searchsorted(first.ends, last.end - SECOND, side="right"))
        start = int(first.starts[late])
        finished = [first.segments[first.opened[late] :], *(block.segments for block in others)]
        covering = join_records([*finished, last.open_segment], SEGMENT)
        # One by one, so that they have the same bits however they came.
        feeds = islice(chain.from_iterable(block.feeds for block in self._blocks), late, None)
        total = account_of(dataclasses.replace(last, start=start, covering=covering))
        return total, sum(feeds, self._no_feed), (last.end - start) / SECOND
