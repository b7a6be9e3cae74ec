"""Rotor: rotation of the drill tool, driven by friction from the piezoelectric stack."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from rpud_sim.drilling.inputs import Disturbances
from rpud_sim.drilling.rotor_values import Resistance, RotorState, RotorWork, Turned
from rpud_sim.foundation.parameters import ParameterGroup, choice, number

# A rotor passes through at most this many laws of motion in one step: it slips, follows the drive,
# slips the other way and stands still.
_MOST_PIECES = 6


@dataclasses.dataclass(frozen=True)
class RotationParameters(ParameterGroup):
    """Parameters of the rotation, in SI units.

    The paper describes the rotor (Section II) and gives none of these values: all are assumed, and
    docs/explanation/drilling.md gives the reasons.

    Raises:
        ParameterError: if a value is outside its range.
    """

    rotation_model: str = choice(
        "none",
        ("none", "friction_drive"),
        "none: the tool does not rotate; friction_drive: the stack drives the rotor by friction",
    )
    rotor_stall_torque: float = number(
        0.1, "N m", "torque of the drive at standstill and nominal amplitude", 1e-6, 100.0
    )
    rotor_no_load_rate: float = number(
        15.0, "rad/s", "rate of the rotor without load at nominal amplitude", 1e-3, 1e4
    )
    rotor_inertia: float = number(
        2e-6, "kg m^2", "moment of inertia of rotor and drill tool about the axis", 1e-12, 1.0
    )
    rotor_preload: float = number(
        50.0, "N", "force of the spring that presses the rotor on the stack", 0.0, 1e4
    )
    rotor_friction_coefficient: float = number(
        0.3, "", "coefficient of friction between rotor and stack", 0.0, 2.0
    )
    rotor_radius: float = number(
        0.01, "m", "mean radius of the contact between rotor and stack", 1e-4, 1.0
    )
    rotor_breakaway_ratio: float = number(
        1.2, "", "torque that starts a tool at rest over that which resists its rotation", 1.0, 10.0
    )


class Rotor:
    """Rotation of the drill tool.

    The drive has the linear curve of an ultrasonic motor, with the vibration's amplitude a over its
    nominal value:

        T_d = T_stall (a - w / w_0)      at most mu F r, the friction of the preloaded contact
        J dw/dt = T_d - T                T: all torques that resist, constant during a step

    So voltage, detuning and load of the actuator act through a. The motion is an exponential where
    the rotor follows the drive, and a parabola where it slips. Each piece ends at its exact time,
    so the result does not depend on how steps with the same torques divide the time. The tool stops
    where the rate reaches zero, and starts when the torque of the drive at rest exceeds the
    resistance times the breakaway ratio. It never turns backward: all that resists is passive.
    """

    def __init__(self, parameters: RotationParameters) -> None:
        self._parameters = parameters
        self._stall_torque = parameters.rotor_stall_torque
        self._inertia = parameters.rotor_inertia
        # Torque that one unit of rate takes from the drive [N m s].
        self._slope = parameters.rotor_stall_torque / parameters.rotor_no_load_rate
        self._grip = (
            parameters.rotor_friction_coefficient
            * parameters.rotor_preload
            * parameters.rotor_radius
        )
        self._play = self._grip / self._slope  # of the rate within which the rotor does not slip
        self._decay = self._slope / self._inertia
        self._whole = _Decay(0.0, 0.0, 0.0, 1.0)  # in a step without another piece
        self._angle = self._rate = self._turned = 0.0
        self._torque = self._drive_torque = 0.0
        self._amplitude_ratio = 0.0
        # Work since time zero, as of ``RotorWork`` [J].
        self._driven = self._slip = 0.0
        self._cutting = self._friction = self._flutes = self._faults = 0.0

    @property
    def state(self) -> RotorState:
        """State at the last step."""
        work = RotorWork(
            self._driven,
            self._slip,
            self._cutting,
            self._friction,
            self._flutes,
            self._faults,
            0.5 * self._inertia * self._rate**2,
        )
        free = self._stall_torque * self._amplitude_ratio - self._slope * self._rate
        return RotorState(
            self._angle,
            self._rate,
            self._torque,
            self._drive_torque,
            self._rate == 0.0 and self._drive_torque > 0.0,
            abs(free) > self._grip and self._amplitude_ratio > 0.0,
            self._turned,
            work,
        )

    def step(
        self,
        interval: float,
        amplitude_ratio: float,
        resistance: Resistance,
        disturbances: Disturbances,
    ) -> Turned:
        """Turn for one step and return what the borehole needs of it.

        Args:
            interval: length of the step [s].
            amplitude_ratio: amplitude of the vibration over its nominal value, not negative.
        """
        cutting, friction, flutes, faults, in_hole = resistance
        if in_hole and disturbances.gravel_torque > 0.0:
            faults += _gravel(self._angle, disturbances)
        torque = cutting + friction + flutes + faults
        turned, rate, drive, slip = self._turn(interval, amplitude_ratio, torque)
        self._drive_torque = self._drive_torque_at(amplitude_ratio, rate)
        self._amplitude_ratio = amplitude_ratio
        self._angle += turned
        self._rate, self._turned = rate, turned
        # At rest the resistance is only as large as the drive.
        self._torque = self._drive_torque if rate == 0.0 else torque
        self._driven += drive
        self._slip += slip
        self._cutting += cutting * turned
        self._friction += friction * turned
        self._flutes += flutes * turned
        self._faults += faults * turned
        resisted = math.fsum((self._cutting, self._friction, self._flutes, self._faults))
        return Turned(turned, self._torque, self._friction, resisted)

    def _drive_torque_at(self, amplitude_ratio: float, rate: float) -> float:
        free = self._stall_torque * amplitude_ratio - self._slope * rate
        if free > self._grip:
            return self._grip
        return free if free > -self._grip else -self._grip

    def _turn(
        self, interval: float, amplitude_ratio: float, torque: float
    ) -> tuple[float, float, float, float]:
        """Return angle [rad], rate at the end [rad/s], work of the drive and loss in slip [J]."""
        inertia = self._inertia
        stack_rate = self._parameters.rotor_no_load_rate * amplitude_ratio
        # Beyond these rates the rotor slips.
        forward, backward = stack_rate - self._play, stack_rate + self._play
        rate, left = self._rate, interval
        angle = drive = slip = 0.0
        for _ in range(_MOST_PIECES):
            if left <= 0.0:
                break
            drive_torque = self._drive_torque_at(amplitude_ratio, rate)
            net = drive_torque - torque
            breakaway = torque * self._parameters.rotor_breakaway_ratio
            if rate == 0.0 and drive_torque <= breakaway:
                slip += drive_torque * stack_rate * left
                break
            if rate < forward or (rate == forward and net < 0.0) or rate > backward:
                # The drive's torque is constant.
                end = max(backward, 0.0) if rate > backward else forward if net > 0.0 else 0.0
                time = (end - rate) * inertia / net if net != 0.0 else math.inf
                if time > left:
                    time, end = left, max(rate + net * left / inertia, 0.0)
                turned = 0.5 * (rate + end) * time
                drive += drive_torque * turned
                slip += drive_torque * (stack_rate * time - turned)
            else:
                lowest = forward if forward > 0.0 else 0.0
                time, end, turned, squared = self._follow(rate, stack_rate, torque, lowest, left)
                # Integrals of rate and of its square give those of torque times rate.
                drive += self._slope * (stack_rate * turned - squared)
                slip += self._slope * (stack_rate**2 * time - 2.0 * stack_rate * turned + squared)
            angle, rate, left = angle + turned, end, left - time
        return angle, rate, drive, slip

    def _follow(
        self, rate: float, stack_rate: float, torque: float, lowest: float, left: float
    ) -> tuple[float, float, float, float]:
        """Return time [s], rate at its end, and integrals of rate and its square over it.

        The rate goes to its steady value by an exponential, until the time is over or the rate
        falls to the lowest at which the rotor follows the drive [rad/s].
        """
        decay = self._decay
        steady = stack_rate - torque / self._slope
        time = math.inf
        if steady < lowest < rate:
            time = math.log1p((rate - lowest) / (lowest - steady)) / decay
        reached = time <= left
        if not reached:
            time = left
            if left != self._whole.time:
                self._whole = _decay_in(left, decay)
        _, once, twice, remains = _decay_in(time, decay) if reached else self._whole
        away = rate - steady
        turned = steady * time + away * once
        squared = steady**2 * time + 2.0 * steady * away * once + away**2 * twice
        end = lowest
        if not reached:
            end = steady + away * remains
            if steady < lowest:
                end = max(end, lowest)  # rounding
        return time, end, turned, squared


class _Decay(NamedTuple):
    """Decay of a rate to its steady value in a time."""

    time: float  # [s]
    once: float  # integral of the rate's distance from its steady value, over that at first [s]
    twice: float  # integral of its square, over that at first [s]
    remains: float  # distance at the end over that at first


def _decay_in(time: float, decay: float) -> _Decay:
    """Return the decay in a time [s] at a rate [1/s]."""
    return _Decay(
        time,
        -math.expm1(-decay * time) / decay,
        -math.expm1(-2.0 * decay * time) / (2.0 * decay),
        math.exp(-decay * time),
    )


def _gravel(angle: float, disturbances: Disturbances) -> float:
    """Return the torque of gravel in the flutes, from 0 to its amplitude [N m]."""
    turns = angle / disturbances.gravel_period
    return 0.5 * disturbances.gravel_torque * (1.0 - math.cos(2.0 * math.pi * turns))
