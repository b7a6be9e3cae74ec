"""Energy account of feed and mount: from the work of the feed to that of the weight on bit."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Sequence

from rpud_sim.drilling.mount import Advance, MountWork
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
    # lost in the damping of the load spring by the mount's motion, beside ``load_damper`` of the
    # ``EnergyAccount``
    load_damper: float = 0.0
    # to the springs of the drill while the mount withdraws from bodies that the rock does not hold;
    # in ``changes`` of the ``EnergyAccount``
    withdrawal_work: float = 0.0
    # W^2 / (2 k_1) - W u_np of the load spring at the end, less that at the start; the rest
    # of its energy is in ``EnergyAccount.stored``
    preload_stored: float = 0.0
    # work of the mount that the percussion does not take, since force and place of the mount are
    # constant for it within a step, and the restoring spring does not pull at the mount
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

    Its force is k_1 (s - u_np), with s = W / k_1 the compression by mount and rock, and c_1 times
    the relative velocity. s changes at the steps alone, by the mount and by the hole.

    Args:
        stored: energy of the arm at time zero [J].
        compression: s at time zero [m].
        spring_rate: with which the load spring pushes, at time zero [N/m].
    """

    def __init__(
        self, stored: float, compression: float, spring_rate: float, position: float
    ) -> None:
        self._compression = compression
        self._spring_rate = spring_rate
        self._first_stored = stored
        # Of the last step, until it is in the engine: way of the origin past the bodies [m], and
        # the part of the preload that this takes [J].
        self._passed = self._left = 0.0
        self._first_preload = self._preload(position)
        self._changes = 0.0
        self._mount_work = 0.0
        self._penetration = 0.0
        self._withdrawal = 0.0
        # Forces of the present step by the velocity of the mount: of the damping, and all [N].
        self._damping_force = self._motion_force = 0.0
        self._damper = 0.0  # loss in the damping, up to the last step [J]
        self._motion_work = 0.0  # of all these forces on the RPUD, up to the last step [J]
        self._start = position  # of the nodal plane at the last step [m]

    def step(self, advance: Advance, spring_rate: float, position: float) -> None:
        """Add a step."""
        way = self._compression
        change = spring_rate - self._spring_rate
        self._changes += change * way * (0.5 * way - position)
        after = advance.compression + advance.passed
        deeper = after - advance.moved
        self._penetration -= _work(spring_rate, position, way, deeper)
        self._mount_work += _work(spring_rate, position, deeper, after)
        self._compression, self._passed = advance.compression, advance.passed
        self._spring_rate, self._left = spring_rate, 0.0
        if advance.passed:
            self._left = _work(spring_rate, position, 0.0, after) - self._preload(position)
        self._damper -= 2.0 * self._damping_force * (position - self._start)
        self._motion_work += self._motion_force * (position - self._start)
        self._damping_force = advance.damping_force
        self._motion_force = advance.damping_force + advance.lead_force
        self._damper += advance.damping_force * advance.moved
        self._start = position

    def shift(self, way: float, work: float) -> None:
        """Count positions from an origin that is further ahead.

        Args:
            work: that this does on the springs of the drill [J].
        """
        self._start -= way
        self._mount_work -= self._left - work
        self._withdrawal += work
        self._passed = self._left = 0.0

    def account(self, work: MountWork, position: float) -> FeedAccount:
        """Return the account since time zero."""
        way = position - self._start
        damper = self._damper - 2.0 * self._damping_force * way
        motion_work = self._motion_work + self._motion_force * way
        return FeedAccount(
            feed_work=work.feed,
            host_work=work.host,
            spring_changes=self._changes,
            guide_friction=work.damper,
            host_slip=work.slip,
            arm_stored=work.stored - self._first_stored,
            penetration_work=self._penetration,
            load_damper=damper,
            withdrawal_work=self._withdrawal,
            preload_stored=self._preload(position) - self._first_preload,
            coupling=work.drill - self._mount_work - damper - motion_work,
        )

    def _preload(self, position: float) -> float:
        way = self._compression
        return self._left + _work(self._spring_rate, position - self._passed, 0.0, way)


def _work(spring_rate: float, position: float, start: float, end: float) -> float:
    """Return the work on the load spring while its other end goes from start to end [J]."""
    return spring_rate * (end - start) * (0.5 * (start + end) - position)
