"""Energy account of a run: joules by term, summed over blocks, and powers over the last second."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections import deque
from itertools import chain, islice

import numpy as np

from rpud_sim.foundation.shared import Shared
from rpud_sim.foundation.time import SECOND, split_fraction
from rpud_sim.model.energy import TERMS
from rpud_sim.model.segment import SEGMENT, join_records
from rpud_sim.model.tally import CLASSES, PART_ROOM, add_block, empty_tallies
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.feed_account import FeedAccount
from rpud_sim.simulation.span import Span

# The powers of a status are means over this time [ns].
_WINDOW = SECOND


def absorbed(impacts: float, release: float, drill_tool_damper: float) -> float:
    """Return what drill tool and rock took for good, from its terms [J]."""
    return math.fsum((impacts, release, drill_tool_damper))


@dataclasses.dataclass(frozen=True)
class EnergyAccount(Shared):
    """Energy that flowed in, was lost and is stored, in joules.

    What flows in is positive: work on the moving bodies. So is what is lost. The account of a run
    begins after the blow at time zero.
    """

    # of the vibration on the free mass, the integral of tip force times v_hv
    actuator_work: float = 0.0
    weight_on_bit_work: float = 0.0  # of the constant force W on the RPUD
    gravity_work: float = 0.0  # on the free mass, and on the RPUD if gravity acts on it
    changes: float = 0.0  # of spring rates and of the drill tool's mass under changed parameters
    load_damper: float = 0.0  # lost in the damping of the load spring
    drill_tool_damper: float = 0.0  # lost in the damping of the drill tool
    actuator_collisions: float = 0.0  # lost in collisions of actuator and free mass, eq. (5).
    # lost in impacts on the drill tool, eqs. (13) and (21); with a blow of the actuator at
    # the same instant, the loss of both.
    impacts: float = 0.0
    release: float = 0.0  # motion and strain of the drill tool that the rock takes after a contact
    # lost, or won, by the resolution of contacts (``tolerances.py``)
    contact_resolution: float = 0.0
    stored: float = 0.0  # in motion and springs at the end, less that at the start
    electrical: float = 0.0  # drawn by the actuator; NaN where its model has no power

    @staticmethod
    def of(block: Block) -> EnergyAccount:
        """Return the account of a block."""
        tally = empty_tallies(1)
        add_block(
            block.rpud,
            block.covering,
            block.impacts[:0],
            split_fraction(block.start),
            split_fraction(block.end),
            False,
            tally,
            np.zeros(CLASSES, np.int64),
            np.zeros(PART_ROOM),
        )
        return EnergyAccount.from_tally(tally[0], block.electrical_energy)

    @staticmethod
    def from_tally(tally: np.void, electrical: float) -> EnergyAccount:
        """Return the account of a tally, with the electrical energy [J]."""
        terms = zip(TERMS, tally["account"].tolist(), strict=True)
        return EnergyAccount(**dict(terms), electrical=electrical)

    def __add__(self, other: EnergyAccount) -> EnergyAccount:
        """Return the account of both."""
        pairs = zip(_values_of(self), _values_of(other), strict=True)
        return EnergyAccount(*(one + another for one, another in pairs))

    @property
    def inflow(self) -> float:
        """Everything that flowed in [J]."""
        return math.fsum(
            (self.actuator_work, self.weight_on_bit_work, self.gravity_work, self.changes)
        )

    @property
    def absorbed(self) -> float:
        """What drill tool and rock took for good [J]."""
        return absorbed(self.impacts, self.release, self.drill_tool_damper)

    @property
    def lost(self) -> float:
        """Everything that was lost [J]."""
        return math.fsum(
            (self.absorbed, self.load_damper, self.actuator_collisions, self.contact_resolution)
        )

    @property
    def residual(self) -> float:
        """Inflow less losses and what is stored [J]; in a sound run rounding alone."""
        return math.fsum((self.inflow, -self.lost, -self.stored))

    def to_dict(self) -> dict[str, float | None]:
        """Return the terms and the residual by name, ready for JSON; None for what is unknown."""
        terms = {**dataclasses.asdict(self), "residual": self.residual}
        return {name: value if math.isfinite(value) else None for name, value in terms.items()}


_values_of = operator.attrgetter(*(field.name for field in dataclasses.fields(EnergyAccount)))


def mean_account(accounts: list[EnergyAccount]) -> EnergyAccount:
    """Return the mean of at least one account, term by term."""
    table = np.array([dataclasses.astuple(account) for account in accounts])
    return EnergyAccount(*table.mean(axis=0).tolist())


class RecentEnergy:
    """Account of the blocks of the last second of simulation time."""

    def __init__(self, has_feed: bool = False) -> None:
        self._has_feed = has_feed
        self._spans: deque[Span] = deque()

    def add(self, span: Span) -> None:
        """Add the blocks that follow."""
        self._spans.append(span)
        while self._spans[0].end <= span.end - _WINDOW:
            self._spans.popleft()

    def powers(self) -> dict[str, float]:
        """Return mean powers by their name in ``rpud_msgs/Status`` [W]; zero before the start.

        ``actuator_power + weight_power + change_power`` is ``load_damper_power + collision_power +
        absorbed_power + stored_power``, and with a feed ``feed_power`` is ``mount_power +
        weight_on_bit_power``. Without one the first two of these are NaN.
        """
        total, feed, duration = EnergyAccount(), self._feed_account(), self._duration()
        if self._spans:
            total = EnergyAccount.of(self._block())
        energies = {
            "actuator_power": total.actuator_work,
            "weight_power": total.weight_on_bit_work + total.gravity_work,
            "change_power": total.changes,
            "load_damper_power": total.load_damper,
            "collision_power": total.actuator_collisions + total.contact_resolution,
            "absorbed_power": total.absorbed,
            "stored_power": total.stored,
            "weight_on_bit_power": total.weight_on_bit_work,
            "feed_power": feed.work if self._has_feed else math.nan,
            "mount_power": feed.kept if self._has_feed else math.nan,
        }
        # What is unknown stays so before the start.
        return {
            name: energy / duration if duration else 0.0 * abs(energy)
            for name, energy in energies.items()
        }

    def coupling_power(self) -> float:
        """Return the mean power of ``FeedAccount.coupling`` [W]; NaN without a feed."""
        if not self._has_feed:
            return math.nan
        duration = self._duration()
        return self._feed_account().coupling / duration if duration else 0.0

    def _late(self) -> int:
        """Return the number of blocks of the first span that ended before the last second."""
        first, last = self._spans[0], self._spans[-1]
        return int(np.searchsorted(first.ends, last.end - _WINDOW, side="right"))

    def _block(self) -> Block:
        """Return the last second as one block, without its impacts; a status waits for it."""
        first, *others = self._spans
        last, late = self._spans[-1], self._late()
        parts = [first.covering[first.opened[late] : -1], *(span.covering[:-1] for span in others)]
        covering = join_records([*parts, last.covering[-1:]], SEGMENT)
        start = int(first.starts[late])
        return Block(start, last.end, covering, last.impacts[:0], last.rpud, math.nan)

    def _duration(self) -> float:
        if not self._spans:
            return 0.0
        return (self._spans[-1].end - int(self._spans[0].starts[self._late()])) / SECOND

    def _feed_account(self) -> FeedAccount:
        # One by one, so that they have the same bits however they came.
        feeds = chain.from_iterable(span.feeds for span in self._spans)
        return sum(islice(feeds, self._late() if self._spans else 0, None), FeedAccount())
