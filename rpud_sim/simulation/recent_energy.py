"""Energy of blocks: the account of one, and mean powers over the last second."""

from __future__ import annotations

import math
from collections import deque
from itertools import chain, islice

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.segment import SEGMENT, join_records
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount

# The powers of a status are means over this time [ns].
_WINDOW = SECOND


def account_of(block: Block) -> EnergyAccount:
    """Return the account of a block."""
    times = (block.start, block.end)
    return EnergyAccount.between(*times, block.covering, block.rpud, block.electrical_energy)


class RecentEnergy:
    """Mean powers over the blocks of the last second of simulation time."""

    def __init__(self, has_feed: bool = False) -> None:
        self._no_feed = FeedAccount(*[0.0 if has_feed else math.nan] * len(vars(FeedAccount())))
        self._blocks: deque[Block] = deque()

    def add(self, block: Block) -> None:
        """Add a block that follows."""
        self._blocks.append(block)
        while self._blocks[0].end <= block.end - _WINDOW:
            self._blocks.popleft()

    def powers(self) -> dict[str, float]:
        """Return mean powers by their name in ``rpud_msgs/Status`` [W]; zero before the start.

        ``actuator_power + weight_power + change_power`` is ``load_damper_power + collision_power +
        absorbed_power + stored_power``, and with a feed ``feed_power`` is ``mount_power +
        weight_on_bit_power``. Without one the first two of these are NaN.
        """
        total = self._drill_account() if self._blocks else EnergyAccount()
        feed = self._feed_account()
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
            "mount_power": feed.kept,
        }
        return {name: self._power(energy) for name, energy in energies.items()}

    def coupling_power(self) -> float:
        """Return the mean power of ``FeedAccount.coupling`` [W]; NaN without a feed."""
        return self._power(self._feed_account().coupling)

    def _power(self, energy: float) -> float:
        if math.isnan(energy):
            return math.nan  # a sum of NaN may have another sign on another processor
        if not self._blocks:
            return 0.0
        first, last = self._blocks[0], self._blocks[-1]
        return energy / ((last.end - int(first.starts[self._late()])) / SECOND)

    def _late(self) -> int:
        """Return the number of parts of the first block that ended before the last second."""
        first, last = self._blocks[0], self._blocks[-1]
        return int(np.searchsorted(first.ends, last.end - _WINDOW, side="right"))

    def _drill_account(self) -> EnergyAccount:
        first, *others = self._blocks
        last, late = self._blocks[-1], self._late()
        parts = [first.covering[first.opened[late] : -1], *(block.segments for block in others)]
        covering = join_records([*parts, last.open_segment], SEGMENT)
        return EnergyAccount.between(int(first.starts[late]), last.end, covering, last.rpud)

    def _feed_account(self) -> FeedAccount:
        # One by one, so that they have the same bits however they came.
        feeds = chain.from_iterable(block.feeds for block in self._blocks)
        return sum(islice(feeds, self._late() if self._blocks else 0, None), self._no_feed)
