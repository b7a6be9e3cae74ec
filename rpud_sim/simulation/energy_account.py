"""Energy accounts: joules by term, of the drill, and of its feed and mount."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:  # Python 3.10 has none
    from typing_extensions import Self


class _Terms:
    """Energies by term, which add up."""

    def __add__(self, other: Self) -> Self:
        return type(self)(*map(operator.add, vars(self).values(), vars(other).values()))

    def __sub__(self, other: Self) -> Self:
        """Return the account of the time after another one that begins with this one."""
        return type(self)(*map(operator.sub, vars(self).values(), vars(other).values()))


Account = TypeVar("Account", bound=_Terms)
Value = TypeVar("Value")


def sum_accounts(accounts: Iterable[Account | None]) -> Account | None:
    """Return the sum of accounts; None if there are none."""
    there = [account for account in accounts if account is not None]
    return sum(there[1:], there[0]) if there else None


def mean_of(values: Sequence[Value]) -> Value:
    """Return the mean of at least one dataclass of numbers, field by field."""
    columns = zip(*(vars(value).values() for value in values), strict=True)
    return type(values[0])(*(math.fsum(column) / len(values) for column in columns))


@dataclasses.dataclass(frozen=True)
class EnergyAccount(_Terms):
    """Energy that flowed in, was lost and is stored, in joules.

    What flows in is positive: work on the moving bodies. So is what is lost. The account of a run
    begins after the blow at time zero.
    """

    # work of the vibration on the free mass, the integral of tip force times v_hv
    actuator_work: float = 0.0
    weight_on_bit_work: float = 0.0  # work of the constant force W on the RPUD
    gravity_work: float = 0.0  # work on the free mass, and on the RPUD if gravity acts on it
    # energy of changed spring rates and drill tool mass, under changed parameters
    changes: float = 0.0
    load_damper: float = 0.0  # lost in the damping of the load spring
    drill_tool_damper: float = 0.0  # lost in the damping of the drill tool
    actuator_collisions: float = 0.0  # lost in collisions of actuator and free mass, eq. (5).
    # lost in impacts on the drill tool, eqs. (13) and (21); with a blow of the actuator at
    # the same instant, the loss of both.
    impacts: float = 0.0
    release: float = 0.0  # motion and strain of the drill tool that the rock takes after a contact
    # lost, or won, by the resolution of contacts (``tolerances.py``)
    contact_resolution: float = 0.0
    stored: float = 0.0  # increase in motion and springs since the start
    electrical: float = 0.0  # drawn by the actuator; NaN where its model has no power

    @property
    def inflow(self) -> float:
        return math.fsum(
            (self.actuator_work, self.weight_on_bit_work, self.gravity_work, self.changes)
        )

    @property
    def absorbed(self) -> float:
        """What drill tool and rock took for good [J]."""
        return math.fsum((self.impacts, self.release, self.drill_tool_damper))

    @property
    def lost(self) -> float:
        return math.fsum(
            (self.absorbed, self.load_damper, self.actuator_collisions, self.contact_resolution)
        )

    @property
    def residual(self) -> float:
        """Inflow less losses and what is stored [J]; in a sound run rounding alone."""
        return math.fsum((self.inflow, -self.lost, -self.stored))

    def to_dict(self) -> dict[str, float | None]:
        """Return the terms and the residual by name, ready for JSON; None for what is unknown."""
        terms = {**vars(self), "residual": self.residual}
        return {name: value if math.isfinite(value) else None for name, value in terms.items()}


@dataclasses.dataclass(frozen=True)
class FeedAccount(_Terms):
    """Energy of feed, arm and load spring, in joules.

    ``feed_work + host_work + spring_changes`` is the sum of all other terms and of the
    ``weight_on_bit_work`` of the ``EnergyAccount``.
    """

    feed_work: float = 0.0  # work of the feed's drive on the arm
    host_work: float = 0.0  # work of a host that slips by a fault
    spring_changes: float = 0.0  # energy of changes of the load spring's rate
    guide_friction: float = 0.0  # lost in the friction of the mount's guide
    host_slip: float = 0.0  # lost where the host slips by the force of the arm
    arm_stored: float = 0.0  # increase in the arm's spring since the start
    penetration_work: float = 0.0  # work of the load spring on the rock, while the hole gets deeper
    # lost in the damping of the load spring by the mount's motion, beside ``load_damper`` of the
    # ``EnergyAccount``
    load_damper: float = 0.0
    # work on the springs of the drill while the mount withdraws from bodies that the rock does not
    # hold; in ``changes`` of the ``EnergyAccount``
    withdrawal_work: float = 0.0
    # increase of W^2 / (2 k_1) - W u_np of the load spring since the start; the rest of its
    # energy is in ``EnergyAccount.stored``
    preload_stored: float = 0.0
    # work of the mount that the percussion does not take, since force and place of the mount are
    # constant for it within a step, and the restoring spring does not pull at the mount
    coupling: float = 0.0

    @property
    def work(self) -> float:
        """Work of the feed's drive, and of a host that slips by a fault [J]."""
        return self.feed_work + self.host_work

    @property
    def mount_work(self) -> float:
        """Part of ``work`` that does not reach the RPUD as work of the weight on bit [J].

        Guide, host and rock take it, arm and load spring store it, or it is ``coupling``. What a
        changed load spring adds is taken off.
        """
        return math.fsum((*self._outflows, -self.spring_changes))

    @property
    def _outflows(self) -> tuple[float, ...]:
        return tuple(vars(self).values())[3:]  # the terms before flow in

    def to_dict(self, weight_on_bit_work: float) -> dict[str, float]:
        """Return the terms and the residual by name, ready for JSON; see ``residual``."""
        return {**vars(self), "residual": self.residual(weight_on_bit_work)}

    def residual(self, weight_on_bit_work: float) -> float:
        """Return what flowed in less where it went [J]; in a sound run rounding alone.

        ``weight_on_bit_work`` is on the RPUD, as of the ``EnergyAccount`` of the same time [J].
        """
        inflows = (self.feed_work, self.host_work, self.spring_changes)
        return math.fsum((*inflows, *(-each for each in self._outflows), -weight_on_bit_work))
