"""Rotor: rotation of the drill tool, driven by friction from the piezoelectric stack."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from rpud_sim.foundation.quantities import ParameterGroup, choice, number
from rpud_sim.model.elementary import exponential, exponential_minus_one, logarithm_one_plus


class Resistance(NamedTuple):
    """Torque against the rotation of the drill tool, immutable and not negative [N m]."""

    cutting: float = 0.0  # torque that cuts the rock
    friction: float = 0.0  # torque of the wear flat on the rock
    flutes: float = 0.0  # torque of cuttings in the flutes
    faults: float = 0.0  # torque of binding and of protruding rock in the flutes


NO_RESISTANCE = Resistance()


@dataclasses.dataclass(frozen=True)
class RotorWork:
    """Work of the rotation since time zero, immutable [J].

    The work of the drive is the sum of cutting, friction, flutes, faults and kinetic energy.
    """

    drawn: float = 0.0  # taken from the stack: what is above ``drive`` heats their friction
    drive: float = 0.0  # work of the drive on the rotor
    cutting: float = 0.0  # work that cut the rock
    friction: float = 0.0  # work of the wear flat on the rock
    flutes: float = 0.0  # work on cuttings in the flutes
    faults: float = 0.0  # work against binding and protruding rock in the flutes
    kinetic: float = 0.0  # energy of the rotation now

    @property
    def resisted(self) -> float:
        return math.fsum((self.cutting, self.friction, self.flutes, self.faults))

    @property
    def residual(self) -> float:
        """Work of the drive less all that became of it [J]; rounding alone."""
        return math.fsum((self.drive, -self.resisted, -self.kinetic))


@dataclasses.dataclass(frozen=True)
class RotorState:
    """State of the rotor at one time, immutable."""

    angle: float = 0.0  # angle since time zero [rad]
    rate: float = 0.0  # rate of rotation, never negative [rad/s]
    torque: float = 0.0  # torque of rock and cuttings on the drill tool, against the rotation [N m]
    drive_torque: float = 0.0  # torque of the drive on the rotor [N m]
    stalled: bool = False  # whether the tool is stalled although the drive is on
    work: RotorWork = RotorWork()  # work since time zero


class RotationStep(NamedTuple):
    """Rotation in one step as the borehole sees it, immutable."""

    angle: float = 0.0  # angle of the step [rad]
    friction: float = 0.0  # work of the wear flat on the rock [J]
    resisted: float = 0.0  # work against everything that resists the rotation [J]


NOT_TURNED = RotationStep()


@dataclasses.dataclass(frozen=True)
class RotationParameters(ParameterGroup):
    """Parameters of the rotation, in SI units.

    The paper describes the rotor (Section II) and gives none of these values: all are assumed, and
    docs/explanation/drilling.md gives the reasons.
    """

    rotation_model: str = choice(
        "none",
        ("none", "friction_drive"),
        "none: the tool does not rotate; friction_drive: the stack drives the rotor by friction",
    )
    rotor_stall_torque: float = number(
        0.1, "N m", "stall torque of the drive at nominal amplitude", 1e-6, 100.0
    )
    rotor_no_load_rate: float = number(
        15.0, "rad/s", "rate of the rotor without load at nominal amplitude", 1e-3, 1e4
    )
    rotor_inertia: float = number(
        2e-6, "kg m^2", "moment of inertia of rotor and drill tool about the axis", 1e-12, 1.0
    )


class Rotor:
    """Rotation of the drill tool: J dw/dt = T_d - T, T all torques that resist, constant in a step.

    The drive has the linear curve of an ultrasonic motor, T_d = T_stall (a - w / w_0), a the
    vibration's amplitude over its nominal value. The tool stops at the exact time at which the rate
    reaches zero, starts when the torque of the drive at rest exceeds the resistance, and never
    turns backward. The stack's surface moves at a w_0: it gives T_d a w_0, of which the slip
    becomes heat.
    """

    def __init__(self, parameters: RotationParameters) -> None:
        self._no_load_rate = parameters.rotor_no_load_rate
        self._stall_torque = parameters.rotor_stall_torque
        self._inertia = parameters.rotor_inertia
        # Torque that one unit of rate takes from the drive [N m s].
        self._slope = parameters.rotor_stall_torque / parameters.rotor_no_load_rate
        self._decay = self._slope / self._inertia
        self._whole = _Decay(0.0, 0.0, 0.0, 1.0)  # decay in a step without another piece
        self._angle = self._rate = 0.0
        self._torque = self._drive_torque = 0.0
        # Work since time zero, as of ``RotorWork`` [J].
        self._drawn = self._driven = 0.0
        self._cutting = self._friction = self._flutes = self._faults = 0.0

    @property
    def state(self) -> RotorState:
        resisted = (self._cutting, self._friction, self._flutes, self._faults)
        kinetic = 0.5 * self._inertia * self._rate * self._rate
        work = RotorWork(self._drawn, self._driven, *resisted, kinetic)
        stalled = self._rate == 0.0 and self._drive_torque > 0.0
        motion = (self._angle, self._rate, self._torque, self._drive_torque)
        return RotorState(*motion, stalled, work)

    @property
    def draw(self) -> tuple[float, float]:
        """Power of the stack on the drive [W], negative if slower, and its energy so far [J]."""
        return self._drive_torque * (self._rate + self._drive_torque / self._slope), self._drawn

    def step(self, interval: float, amplitude_ratio: float, resistance: Resistance) -> RotationStep:
        """Turn for one step at an amplitude over nominal; return what the borehole needs of it."""
        cutting, friction, flutes, faults = resistance
        torque = cutting + friction + flutes + faults
        turned, rate, drive = self._turn(interval, amplitude_ratio, torque)
        self._drive_torque = self._drive_torque_at(amplitude_ratio, rate)
        # The stack moves at the rate at which the torque of the drive is zero.
        stack_rate = self._no_load_rate * amplitude_ratio
        self._drawn += self._slope * stack_rate * (stack_rate * interval - turned)
        self._angle += turned
        self._rate = rate
        # At rest the resistance is only as large as the drive.
        self._torque = self._drive_torque if rate == 0.0 else torque
        self._driven += drive
        self._cutting += cutting * turned
        self._friction += friction * turned
        self._flutes += flutes * turned
        self._faults += faults * turned
        return RotationStep(turned, friction * turned, torque * turned)

    def _drive_torque_at(self, amplitude_ratio: float, rate: float) -> float:
        return self._stall_torque * amplitude_ratio - self._slope * rate

    def _turn(
        self, interval: float, amplitude_ratio: float, torque: float
    ) -> tuple[float, float, float]:
        """Return angle [rad], rate at the end [rad/s] and work of the drive [J]."""
        rate = self._rate
        if rate == 0.0 and self._drive_torque_at(amplitude_ratio, rate) <= torque:
            return 0.0, 0.0, 0.0
        stack_rate = self._no_load_rate * amplitude_ratio
        steady = stack_rate - torque / self._slope
        if interval != self._whole.time:
            self._whole = _decay_in(interval, self._decay)
        decay, end = self._whole, 0.0
        if steady < 0.0 < rate:
            stop = logarithm_one_plus(rate / -steady) / self._decay
            if stop <= interval:
                decay = _decay_in(stop, self._decay)
        time, once, twice, remains = decay
        away = rate - steady
        if decay is self._whole:
            end = steady + away * remains
            if end < 0.0:
                end = 0.0  # rounding
        turned = steady * time + away * once
        squared = steady * steady * time + 2.0 * steady * away * once + away * away * twice
        # The integral of torque times rate follows from the integrals of rate and squared rate.
        return turned, end, self._slope * (stack_rate * turned - squared)


class _Decay(NamedTuple):
    time: float  # [s]
    once: float  # integral of the rate's distance from its steady value, over that at first [s]
    twice: float  # integral of its square, over that at first [s]
    remains: float  # distance at the end over that at first


def _decay_in(time: float, decay: float) -> _Decay:
    return _Decay(
        time,
        -exponential_minus_one(-decay * time) / decay,
        -exponential_minus_one(-2.0 * decay * time) / (2.0 * decay),
        exponential(-decay * time),
    )
