"""Mount: a feed or another simulator moves the drill along its axis; the weight on bit follows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

from rpud_sim.drilling.arm import Arm, Move, SpringLoad, arm_force, move_freely, move_rest_position
from rpud_sim.drilling.inputs import Disturbances, Percussion
from rpud_sim.foundation.quantities import (
    Choice,
    ParameterError,
    ParameterGroup,
    Quantity,
    choice,
    number,
)
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.parameters import QUANTITIES

RATE = "rate"
POSITION = "position"
# Modes, in the order of the MODE constants of ``rpud_msgs/Feed``
FEED_MODES = (RATE, POSITION)

FEED_MODE = Choice("motion of the feed", FEED_MODES)
FEED_RATE = Quantity("m/s", "rate of the feed toward the rock", -1.0, 1.0)
FEED_POSITION = Quantity("m", "position of the feed along the drill axis", -1.0, 1.0)
Limits = Mapping[str, Quantity]  # limits of position and rate


@dataclasses.dataclass(frozen=True)
class Feed:
    """Motion that the drive of the feed, which carries the mount, is to make."""

    mode: str  # ``rate`` or ``position``
    value: float  # rate toward the rock [m/s], or position along the drill axis [m]

    def __post_init__(self) -> None:
        FEED_MODE.check("feed mode", self.mode)
        quantity = FEED_RATE if self.mode == RATE else FEED_POSITION
        object.__setattr__(self, "value", quantity.check(f"feed {self.mode}", self.value))

    def check(self, limits: Limits) -> None:
        limits[self.mode].check(f"feed {self.mode}", self.value)

    def wanted(self, feed: float, time: int, interval: float) -> float:
        """Place at a time [ns], after an interval [s] that began at the place ``feed`` [m]."""
        return feed + self.value * interval if self.mode == RATE else self.value

    def left(self, share: float, place: float) -> Feed:
        """What is left of it while a share of the commands acts: a position is given up."""
        if share == 1.0:
            return self
        return Feed(RATE, self.value * share) if share and self.mode == RATE else STOPPED


STOPPED = Feed(RATE, 0.0)


@dataclasses.dataclass(frozen=True)
class MountMotion:
    """Sample of the motion of a mount that another simulator carries.

    Until the next sample the mount keeps this velocity: x = position + velocity (t - sampled).
    """

    position: float  # along the drill axis, toward the rock [m]
    velocity: float = 0.0  # toward the rock [m/s]
    sampled: int | None = None  # simulation time of both [ns]; None for when it acts

    def __post_init__(self) -> None:
        for name, quantity in (("position", FEED_POSITION), ("velocity", FEED_RATE)):
            value = quantity.check(f"mount {name}", getattr(self, name))
            object.__setattr__(self, name, value)

    def acting(self, now: int) -> MountMotion:
        """Return the motion of a sample that acts from now on [ns]; at rest it has no time."""
        sampled = now if self.sampled is None else self.sampled
        return dataclasses.replace(self, sampled=sampled if self.velocity else 0)

    def check(self, limits: Limits) -> None:
        limits[POSITION].check("mount position", self.position)
        limits[RATE].check("mount velocity", self.velocity)

    def wanted(self, feed: float, time: int, interval: float) -> float:
        """Place at a time [ns], where the motion acts [m]."""
        return self.position + self.velocity * ((time - (self.sampled or 0)) / SECOND)

    def left(self, share: float, place: float) -> MountMotion:
        """What is left of it while a share of the commands acts, from its current place [m] on."""
        return self if share == 1.0 else MountMotion(place, self.velocity * share)


# A command of the mount's motion: where the mount is to be, and what is left when it is lost.
Motion = Feed | MountMotion
_GIVERS = {"none": None, "arm": Feed, "given": MountMotion}


@dataclasses.dataclass(frozen=True)
class MountParameters(ParameterGroup):
    """Parameters of feed and arm, in SI units.

    The paper gives none of them: all are assumed.
    """

    feed_model: str = choice(
        "none",
        tuple(_GIVERS),
        "none: the weight on bit is commanded; arm: a feed on an arm is commanded, and the weight "
        "on bit follows; given: the motion of the mount is commanded, as another simulator has it",
    )
    initial_feed: float = number(
        0.0,
        "m",
        "position of the feed at time zero; at zero the tool just touches the rock",
        -1.0,
        1.0,
    )
    feed_minimum: float = number(-0.1, "m", "least position of the feed", -1.0, 1.0)
    feed_maximum: float = number(0.3, "m", "greatest position of the feed", -1.0, 1.0)
    feed_rate_limit: float = number(
        5e-3, "m/s", "greatest rate of the feed, in both directions", 1e-9, 1.0
    )
    arm_stiffness: float = number(
        2e4, "N/m", "stiffness of the arm along the drill axis; 0 for a rigid arm", 0.0, 1e7
    )
    arm_damping: float = number(
        200.0, "N s/m", "viscous friction of the mount in its guide", 1e-3, 1e6
    )
    arm_play: float = number(0.0, "m", "whole play between feed and mount", 0.0, 1e-2)
    anchoring_force: float = number(
        100.0, "N", "force of the arm above which its host slips", 1e-3, 1e3
    )
    contact_release: float = number(
        1e-4,
        "m",
        "distance behind the bottom of the hole at which the drill tool leaves the rock",
        0.0,
        1e-2,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.feed_minimum <= self.initial_feed <= self.feed_maximum:
            raise ParameterError(
                f"initial_feed = {self.initial_feed:g} m is not between "
                f"feed_minimum = {self.feed_minimum:g} m and "
                f"feed_maximum = {self.feed_maximum:g} m"
            )

    @property
    def command_type(self) -> type[Motion] | None:
        """Class of the commands that give the motion of the mount; None if it rests."""
        return _GIVERS[self.feed_model]

    @property
    def rest(self) -> Motion:
        """Motion until the first command."""
        return (
            MountMotion(self.initial_feed, sampled=0)
            if self.command_type is MountMotion
            else STOPPED
        )

    @property
    def limits(self) -> Limits:
        return {
            POSITION: Quantity("m", "", self.feed_minimum, self.feed_maximum),
            RATE: Quantity("m/s", "", -self.feed_rate_limit, self.feed_rate_limit),
        }


@dataclasses.dataclass(frozen=True)
class MountWork:
    """Energies of feed and arm since time zero, in joules.

    ``feed + host`` is ``damper + slip + drill`` and the change of ``stored``.
    """

    feed: float = 0.0  # work of the feed's drive
    damper: float = 0.0  # lost in the friction of the guide
    slip: float = 0.0  # lost where the host slips by the force of the arm
    host: float = 0.0  # work of a host that slips by itself, by a fault
    stored: float = 0.0  # energy in the arm's spring now
    drill: float = 0.0  # work on the drill, against its reacting force


@dataclasses.dataclass(frozen=True)
class MountState:
    """State of feed and mount at one time, immutable.

    Positions are along the drill axis, positive toward the rock. At zero the tool of an unloaded
    arm just touches the rock before drilling.
    """

    position: float  # position of the mount [m]
    feed: float  # position of the feed's drive [m]
    rate: float  # rate of the feed's drive [m/s]
    force: float  # force of the arm on the mount, toward the rock [N]
    weight_on_bit: float  # force of the load spring, compressed between mount and rock [N]
    in_contact: bool  # whether the drill tool is in the rock
    slip: float  # travel of the host since time zero, toward the rock [m]
    bottom: float  # bottom of the hole [m]; infinite if there is none
    # Within a step the force of the drill on the mount follows a deviation of the mount by these.
    stiffness: float  # rate of the load spring [N/m]
    damping: float  # damping of the load spring [N s/m]
    swings: bool  # whether the velocity of a given motion changes its sign each time, undamped
    work: MountWork = MountWork()  # energies since time zero


class Advance(NamedTuple):
    """Motion of the mount in one step, as the bodies of the drill see it."""

    # distance of the mount beyond the origin of the bodies' displacements, after the step [m]
    compression: float
    moved: float = 0.0  # distance of the mount past the bodies' places [m]
    passed: float = 0.0  # distance of the origin past the bodies' places [m]
    dragged: float = 0.0  # loss in the damping by the velocity of the mount alone [J]
    # force on the RPUD in the next step, by the velocity of the mount [N]
    damping_force: float = 0.0
    # force of the load spring by the distance that the mount makes in half of the next step [N]
    lead_force: float = 0.0


# Greatest force of the load spring under a given motion [N], as of ``weight_on_bit``.
_MOST_FORCE = QUANTITIES["weight_on_bit"].maximum

# Consecutive samples whose velocity changes its sign without decaying, after which the exchange
# with another simulator counts as unstable; and the least velocity that counts [m/s].
_SWINGS = 8
_SLOW = 1e-3

# Instead of the arm, where the mount is given: it is rigid, and its host never slips.
_CARRIED = Arm(0.0, 1.0, 0.0, 1e12)


class Mount:
    """Mount of the drill on a feed, or carried by another simulator.

    The load spring is compressed by what mount and hole leave it: W = k_1 (x - p). The tool gets
    into the rock where x is beyond the bottom p of the hole, and leaves it ``contact_release``
    before it. From then on the drill's displacements count from the mount, x = o: each step moves
    this origin and leaves the bodies where they are. They go along with the drive of the feed
    alone.
    """

    def __init__(
        self, parameters: MountParameters, load_spring_rate: float, has_rock: bool
    ) -> None:
        self._parameters = parameters
        self._limits = (parameters.feed_minimum, parameters.feed_maximum)
        self._arm = Arm(
            parameters.arm_stiffness,
            parameters.arm_damping,
            0.5 * parameters.arm_play,
            parameters.anchoring_force,
        )
        self.motion = parameters.rest
        if parameters.command_type is MountMotion:
            self._arm = _CARRIED
        # The arm has come to rest under the load spring before time zero.
        self.position = self._feed = start = parameters.initial_feed
        self.in_contact = has_rock and start > 0.0
        self.bottom = 0.0 if has_rock else math.inf
        self._load = SpringLoad(load_spring_rate, 0.0, 0.0 if self.in_contact else start, 0.0)
        self._slip = 0.0
        if self.in_contact:
            settled = move_freely(self._arm, self._load, start, start, math.inf)
            self.position, self._slip = settled.position, settled.slipped
        self._rate = 0.0  # rate of the feed's drive [m/s]
        self._damping = 0.0  # damping of the load spring [N s/m]
        self._sign_changes = 0  # consecutive samples whose velocity changes its sign, undamped
        self._speed_before = 0.0  # speed of the sample before the last one [m/s]
        self._stalled = False  # whether the feed stalls by a fault
        self._last_interval = math.inf  # duration of the last step [s]
        self.advance = Advance(self.position - self._load.origin)  # advance in the last step
        self._feed_work = self._damper_loss = self._slip_loss = self._host_work = 0.0
        self._drill_work = 0.0

    @property
    def state(self) -> MountState:
        rest = self._rest
        stored = self._arm.stored(self.position - rest)
        force = arm_force(self._arm, self._load, self.position, rest)
        lost = (self._damper_loss, self._slip_loss)
        work = MountWork(self._feed_work, *lost, self._host_work, stored, self._drill_work)
        drive = (self.position, self._feed, self._rate)
        contact = (self.weight_on_bit, self.in_contact)
        impedance = (self._load.spring_rate, self._damping)
        swings = self._sign_changes >= _SWINGS
        return MountState(
            *(*drive, force, *contact, self._slip, self.bottom, *impedance, swings, work)
        )

    @property
    def weight_on_bit(self) -> float:
        """Force of the load spring, compressed between mount and rock [N], at least zero."""
        return max(self._load.spring_rate * self.advance.compression, 0.0)

    @property
    def preload(self) -> float:
        """Force on the RPUD by position and velocity of the mount until the next step [N]."""
        advance = self.advance
        spring = self._load.spring_rate * advance.compression
        return spring + advance.damping_force + advance.lead_force

    def step(
        self,
        time: int,
        interval: float,
        bottom: float,
        percussion: Percussion,
        spring_rate: float,
        disturbances: Disturbances,
    ) -> None:
        """Move to a time [ns] in one step, to a hole whose bottom [m] is infinite without one.

        The arm moves under the hole and the feed of the step before; then both have moved.
        """
        damping = percussion.load_damping
        # What the drill's own motion takes from the force of the load spring.
        push = self.preload - percussion.reacting_force
        position, deflection = self.position, self.position - self._feed
        load = SpringLoad(spring_rate, damping, self._load.origin, push)
        self._take(move_freely(self._arm, load, self.position, self._rest, interval), damping)
        if disturbances.arm_slip_rate:
            slip = self._slip - disturbances.arm_slip_rate * interval
            self._host_work += self._shift(load, self._feed, slip)
        self._stalled, self._last_interval = disturbances.feed_stalled, interval
        feed = self._next_feed(time, interval, self._stalled)
        self._rate = (feed - self._feed) / interval
        if feed != self._feed:
            start = self.position
            self._feed_work += self._shift(load, feed, self._slip)
            # What moves the mount itself moves it against the damping of the load spring, too.
            carried = self.position - start
            dragged = damping * (carried / interval) * carried
            self._feed_work += dragged
            self._drill_work += dragged
        travel = self.position - position
        if not self.in_contact:
            travel = (self.position - self._feed) - deflection
        self._arrive(load, bottom, travel, interval, percussion.reach)

    def check(self, motion: Motion) -> None:
        """Check that a motion does not press with more than a weight on bit can be."""
        if isinstance(motion, MountMotion):
            force = self._load.spring_rate * (motion.position - self.bottom)
            if force > _MOST_FORCE:
                most = self.bottom + _MOST_FORCE / self._load.spring_rate
                raise ParameterError(
                    f"mount position = {motion.position:g} m presses with {force:.4g} N, more than "
                    f"{_MOST_FORCE:g} N: allowed is up to {most:.6g} m"
                )

    def set_motion(self, motion: Motion) -> None:
        before, self.motion = self.motion, motion
        if isinstance(motion, MountMotion) and isinstance(before, MountMotion):
            turned = motion.velocity * before.velocity < 0.0
            undamped = abs(motion.velocity) > max(0.9 * self._speed_before, _SLOW)
            self._sign_changes = self._sign_changes + 1 if turned and undamped else 0
            self._speed_before = abs(before.velocity)

    def look_ahead(self, time: int, interval: float, spring_rate: float, damping: float) -> None:
        """Take the forces of the step that comes, until a time [ns], from a given motion.

        Its velocity is known when the step begins. The velocity of an arm is from the step before.
        Motions that come more often than steps cut these: then the step will be as long as the
        last one.
        """
        self._damping = damping
        if self._parameters.command_type is not MountMotion:
            return
        distance, rate = 0.0, 0.0
        if self.in_contact and interval > 0.0:
            if self._last_interval < interval:
                time -= round((interval - self._last_interval) * SECOND)
                interval = self._last_interval
            distance = self._next_feed(time, interval, self._stalled) - self._feed
            rate = distance / interval
        forces = (damping * rate, 0.5 * spring_rate * distance)
        self.advance = self.advance._replace(damping_force=forces[0], lead_force=forces[1])

    @property
    def _rest(self) -> float:
        """Place of the mount at which the arm is not deflected [m]."""
        return self._feed + self._slip

    def _shift(self, load: SpringLoad, feed: float, slip: float) -> float:
        """Let feed and host jump; return the work that this takes [J]."""
        rest = self._rest
        self._feed, self._slip = feed, slip
        moved = move_rest_position(self._arm, load, self.position, rest, self._rest)
        self._take(moved)
        return moved.shift_work

    def _take(self, moved: Move, load_damping: float = 0.0) -> None:
        self.position, slipped, damper, slip, work, _ = moved
        share = load_damping / (load_damping + self._arm.damping)
        self._slip += slipped
        self._damper_loss += (1.0 - share) * damper
        self._slip_loss += slip
        self._drill_work += work + share * damper

    def _next_feed(self, time: int, interval: float, stalled: bool) -> float:
        """Position of the feed's drive, or of what carries the mount, after a step [m]."""
        feed, motion = self._feed, self.motion
        if stalled or motion is STOPPED:
            return feed
        least, greatest = self._limits
        most = self._parameters.feed_rate_limit * interval
        wanted = motion.wanted(feed, time, interval)
        wanted = least if wanted < least else greatest if wanted > greatest else wanted
        if wanted < feed - most:
            return feed - most
        return feed + most if wanted > feed + most else wanted

    def _arrive(
        self, load: SpringLoad, bottom: float, travel: float, interval: float, reach: float
    ) -> None:
        """Note what follows from the place that the mount has reached.

        ``travel`` is the mount's as the bodies see it, ``reach`` how far the actuator's tip comes
        until the next step, from the origin [m]: there the rock must have the tool already.
        """
        was_in_contact, self.bottom = self.in_contact, bottom
        if self.position > bottom or load.origin + reach > bottom:
            self.in_contact = True
        elif self.position < bottom - self._parameters.contact_release:
            self.in_contact = False
        origin = bottom if self.in_contact else self.position
        passed = 0.0
        if not was_in_contact:
            passed = travel - (self.position - origin)
        elif not self.in_contact:
            passed = self.position - load.origin
        push = load.push - load.spring_rate * passed
        self._load = load._replace(origin=origin, push=push)
        damping, lead = load.damping * (travel / interval), 0.5 * load.spring_rate * travel
        forces = (damping * travel, damping, lead)
        self.advance = Advance(self.position - origin, travel, passed, *forces)
