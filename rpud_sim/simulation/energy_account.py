"""Energy account of a run: joules by term, summed over blocks, and powers over the last second."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections import deque

import numpy as np

from rpud_sim.foundation.shared import Shared
from rpud_sim.foundation.time import SECOND, split_fraction
from rpud_sim.model.boundaries import add_blocks
from rpud_sim.model.energy import TERMS, add_segments
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
        terms = dict(zip(TERMS, _joules_of(block).tolist(), strict=True))
        return EnergyAccount(**terms, electrical=block.electrical_energy)

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


def _joules_of(block: Block) -> np.ndarray:
    """Return the ``TERMS`` of a block's account [J]."""
    joules = np.zeros(len(TERMS))
    add_segments(
        block.rpud,
        block.covering,
        *split_fraction(block.start),
        *split_fraction(block.end),
        joules,
    )
    return joules


def mean_account(accounts: list[EnergyAccount]) -> EnergyAccount:
    """Return the mean of at least one account, term by term."""
    table = np.array([dataclasses.astuple(account) for account in accounts])
    return EnergyAccount(*table.mean(axis=0).tolist())


class RecentEnergy:
    """Accounts of the blocks of the last second of simulation time."""

    def __init__(self, has_feed: bool = False) -> None:
        # Start, end and terms of each block; as bytes, which copies of a run share. Those of a
        # span wait until they are wanted.
        self._blocks: deque[tuple[int, int, bytes]] = deque()
        self._spans: deque[Span] = deque()
        self._has_feed = has_feed
        self._feeds: deque[tuple[int, FeedAccount]] = deque()  # with the end of each block

    def add(self, block: Block) -> None:
        """Add the block that follows."""
        self._calculate()
        self._blocks.append((block.start, block.end, _joules_of(block).tobytes()))
        if block.feed is not None:
            self._feeds.append((block.end, block.feed))
        self._forget(block.end)

    def add_span(self, span: Span) -> None:
        """Add the blocks that follow."""
        self._spans.append(span)
        while self._spans[0].end <= span.end - _WINDOW:
            self._spans.popleft()
        if span.feeds:
            self._feeds.extend(zip(span.ends.tolist(), span.feeds, strict=True))
        self._forget(span.end)

    def _forget(self, time: int) -> None:
        while self._blocks and self._blocks[0][1] <= time - _WINDOW:
            self._blocks.popleft()
        while self._feeds and self._feeds[0][0] <= time - _WINDOW:
            self._feeds.popleft()

    def _calculate(self) -> None:
        for span in self._spans:
            seconds, rest = np.divmod(np.concatenate([[span.start], span.ends]), SECOND)
            joules = np.zeros((len(span), len(TERMS)))
            add_blocks(
                span.rpud,
                span.covering,
                span.opened,
                span.finished,
                seconds,
                rest / SECOND,
                joules,
            )
            times = zip(span.starts.tolist(), span.ends.tolist(), strict=True)
            self._blocks.extend(
                (*pair, terms.tobytes()) for pair, terms in zip(times, joules, strict=True)
            )
            self._forget(span.end)
        self._spans.clear()

    def powers(self) -> dict[str, float]:
        """Return mean powers by their name in ``rpud_msgs/Status`` [W]; zero before the start.

        ``actuator_power + weight_power + change_power`` is ``load_damper_power + collision_power +
        absorbed_power + stored_power``, and with a feed ``feed_power`` is ``mount_power +
        weight_on_bit_power``. Without one the first two of these are NaN.
        """
        self._calculate()
        rows = b"".join(terms for _, _, terms in self._blocks)
        # A status waits for it, and a second has up to 1,000 blocks. Block by block in their order,
        # or the powers would have other bits than those of earlier versions.
        table = np.frombuffer(bytes(8 * len(TERMS)) + rows).reshape(-1, len(TERMS))
        terms = dict(zip(TERMS, table.cumsum(axis=0)[-1].tolist(), strict=True))
        total = EnergyAccount(**terms)
        duration = (self._blocks[-1][1] - self._blocks[0][0]) / SECOND if self._blocks else 0.0
        energies = {
            "actuator_power": total.actuator_work,
            "weight_power": total.weight_on_bit_work + total.gravity_work,
            "change_power": total.changes,
            "load_damper_power": total.load_damper,
            "collision_power": total.actuator_collisions + total.contact_resolution,
            "absorbed_power": total.absorbed,
            "stored_power": total.stored,
            "weight_on_bit_power": total.weight_on_bit_work,
            **self._feed_energies(),
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
        duration = (self._blocks[-1][1] - self._blocks[0][0]) / SECOND if self._blocks else 0.0
        return self._feed_account().coupling / duration if duration else 0.0

    def _feed_account(self) -> FeedAccount:
        return sum((account for _, account in self._feeds), FeedAccount())

    def _feed_energies(self) -> dict[str, float]:
        """Return the work of the feed, and of it what does not reach the drill [J]."""
        if not self._has_feed:
            return {"feed_power": math.nan, "mount_power": math.nan}
        total = self._feed_account()
        return {"feed_power": total.work, "mount_power": total.kept}
