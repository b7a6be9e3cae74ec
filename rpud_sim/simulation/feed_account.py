"""Energy account of feed and mount: from the work of the feed to that of the weight on bit."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Sequence

from rpud_sim.drilling.mount import MountState, MountWork
from rpud_sim.foundation.shared import Shared


@dataclasses.dataclass(frozen=True)
class FeedAccount(Shared):
    """Energy of feed, arm and load spring, in joules.

    ``feed_work + host_work + spring_changes`` is the sum of all other terms and of the
    ``weight_on_bit_work`` of the ``EnergyAccount``.
    """

    feed_work: float = 0.0  # of the feed's drive on the arm
    host_work: float = 0.0  # of a host that slips by a fault
    spring_changes: float = 0.0  # of the load spring's rate, under changed parameters
    guide_friction: float = 0.0  # lost in the friction of the mount's guide
    host_slip: float = 0.0  # lost where the host slips by the force of the arm
    arm_stored: float = 0.0  # in the arm's spring at the end, less that at the start
    penetration_work: float = 0.0  # of the load spring on the rock, while the hole gets deeper
    # W^2 / (2 k_1) - W u_np of the load spring at the end, less that at the start; the rest
    # of its energy is in ``EnergyAccount.stored``
    preload_stored: float = 0.0
    # work of the mount that the percussion does not take, since its weight on bit is constant
    # within a step and its frame is at rest
    coupling: float = 0.0

    def __add__(self, other: FeedAccount) -> FeedAccount:
        """Return the account of both."""
        return FeedAccount(*map(operator.add, _values_of(self), _values_of(other)))

    def __sub__(self, other: FeedAccount) -> FeedAccount:
        """Return the account of the time after another one that begins with this one."""
        return FeedAccount(*map(operator.sub, _values_of(self), _values_of(other)))

    @property
    def work(self) -> float:
        """Work of the feed's drive, and of a host that slips by a fault [J]."""
        return self.feed_work + self.host_work

    @property
    def kept(self) -> float:
        """Part of ``work`` that does not reach the RPUD as work of the weight on bit [J].

        Guide, host and rock take it, arm and load spring store it, or it is ``coupling``. What a
        changed load spring adds is taken off.
        """
        values = _values_of(self)
        return math.fsum((*values[_INFLOWS:], -self.spring_changes))

    def to_dict(self, weight_on_bit_work: float) -> dict[str, float]:
        """Return the terms and the residual by name, ready for JSON; see ``residual``."""
        return {**dataclasses.asdict(self), "residual": self.residual(weight_on_bit_work)}

    def residual(self, weight_on_bit_work: float) -> float:
        """Return what flowed in less where it went [J]; in a sound run rounding alone.

        Args:
            weight_on_bit_work: on the RPUD, as of the ``EnergyAccount`` of the same time [J].
        """
        values = _values_of(self)
        outflow = [-each for each in values[_INFLOWS:]]
        return math.fsum((*values[:_INFLOWS], *outflow, -weight_on_bit_work))


_INFLOWS = 3  # first terms of the account, which flow in
_values_of = operator.attrgetter(*(field.name for field in dataclasses.fields(FeedAccount)))


def mean_feed_account(accounts: Sequence[FeedAccount]) -> FeedAccount | None:
    """Return the mean of accounts, term by term; None if there are none."""
    if not accounts:
        return None
    columns = zip(*map(_values_of, accounts), strict=True)
    return FeedAccount(*(math.fsum(column) / len(accounts) for column in columns))


class LoadSpring:
    """Energy of the load spring between mount and RPUD, from step to step.

    Its force is k_1 (s - u_np), with s = W / k_1 the way of the mount beyond the bottom of the
    hole. s changes at the steps alone, by the mount and by the hole.

    Args:
        spring_rate: with which the load spring pushes, at time zero [N/m].
    """

    def __init__(self, state: MountState, spring_rate: float, position: float) -> None:
        self._place = (state.position, state.bottom)
        self._spring_rate = spring_rate
        self._first_stored = state.work.stored
        self._first_preload = self._preload(position)
        self._changes = 0.0
        self._mount_work = 0.0
        self._penetration = 0.0

    def step(self, place: tuple[float, float], spring_rate: float, position: float) -> None:
        """Add a step.

        Args:
            place: position of the mount and bottom of the hole after it [m].
        """
        mount, bottom = self._place
        way = _compression(mount, bottom)
        change = spring_rate - self._spring_rate
        self._changes += change * way * (0.5 * way - position)
        deeper = _compression(mount, place[1])
        after = _compression(*place)
        self._penetration -= _work(spring_rate, position, way, deeper)
        self._mount_work += _work(spring_rate, position, deeper, after)
        self._place = place
        self._spring_rate = spring_rate

    def account(self, work: MountWork, position: float) -> FeedAccount:
        """Return the account since time zero."""
        return FeedAccount(
            feed_work=work.feed,
            host_work=work.host,
            spring_changes=self._changes,
            guide_friction=work.damper,
            host_slip=work.slip,
            arm_stored=work.stored - self._first_stored,
            penetration_work=self._penetration,
            preload_stored=self._preload(position) - self._first_preload,
            coupling=work.drill - self._mount_work,
        )

    def _preload(self, position: float) -> float:
        way = _compression(*self._place)
        return self._spring_rate * way * (0.5 * way - position)


def _compression(position: float, bottom: float) -> float:
    """Return the way of a mount beyond the bottom of the hole [m]."""
    return position - bottom if position > bottom else 0.0


def _work(spring_rate: float, position: float, start: float, end: float) -> float:
    """Return the work on the load spring while its other end goes from start to end [J]."""
    return spring_rate * (end - start) * (0.5 * (start + end) - position)
