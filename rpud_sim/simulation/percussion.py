"""What percussion and slow processes exchange at each step: impacts, forces, and their energy."""

from __future__ import annotations

from array import array

import numpy as np

from rpud_sim.drilling.inputs import NO_PULSES, Percussion, Pulses
from rpud_sim.drilling.mount import Advance, MountWork
from rpud_sim.model.compile import reader_of
from rpud_sim.model.drill import DrillConstants
from rpud_sim.model.elementary import exponential, sin_cos, sin_cos_cycles
from rpud_sim.model.segment import SEGMENT
from rpud_sim.simulation.energy_account import FeedAccount

# Time constant of the mean force on the rock [s]: most of a period of the RPUD on its load spring.
FORCE_WINDOW = 0.1

_nodal_plane = reader_of(
    SEGMENT,
    "start_seconds",
    "start_fraction",
    "vibration_phase",
    "vibration_frequency",
    "nodal_plane_offset",
    "nodal_plane_decay_rate",
    "nodal_plane_angular_frequency",
    "nodal_plane_cosine",
    "nodal_plane_sine",
    "nodal_plane_vibration_sine",
    "nodal_plane_vibration_cosine",
)


def nodal_plane_position(segment: np.ndarray, seconds: int, fraction: float) -> float:
    """Return u_np at a time in a segment [m], from its closed form, eqs. (2) and (18)."""
    start, rest, phase, frequency, offset, decay, omega, cosine, sine, in_phase, in_quadrature = (
        _nodal_plane(segment)
    )
    elapsed = float(seconds - start) + (fraction - rest)
    turned_sine, turned_cosine = sin_cos(omega * elapsed)
    swing = cosine * turned_cosine + sine * turned_sine
    position: float = offset + exponential(-decay * elapsed) * swing
    if in_phase or in_quadrature:
        turned_sine, turned_cosine = sin_cos_cycles(phase + frequency * elapsed)
        position += in_phase * turned_sine + in_quadrature * turned_cosine
    return position


class PercussionMeter:
    """Impacts and forces since the last step of the slow processes.

    The mean of R = W - k_1 u_np - c_1 v_np takes u_np as linear in the step: its period on the load
    spring is a hundred times as long. W has the force by the velocity of the mount as well. By
    momentum the rock bears, on average, R with the weights of the free mass and, with
    ``gravity_on_drill``, of the RPUD: at a standstill the weight on bit with these. The mean of R
    fades with ``FORCE_WINDOW``.
    """

    def __init__(self, vibration_amplitude: float, position: float, weight_on_bit: float) -> None:
        self._nominal = vibration_amplitude
        self._position = position
        self._mean_force = weight_on_bit  # mean of R [N]
        self._energies, self._impulses, self._durations = (array("d") for _ in range(3))
        # Pulses, their impulse and their duration in a second, means of all
        self._pulses = (0.0, 0.0, 0.0)
        self.arrived = 0.0  # energy of all impacts [J]

    def shift(self, distance: float) -> None:
        """Count positions from an origin that is further ahead."""
        self._position -= distance

    def add(self, impacts: np.ndarray) -> None:
        """Add ``IMPACT`` records of impacts that have ended."""
        self._energies.extend(impacts["energy_transferred"].tolist())
        self._impulses.extend(impacts["impulse"].tolist())
        self._durations.extend(impacts["contact_duration"].tolist())

    def read(
        self,
        interval: float,
        position: float,
        weight_on_bit: float,
        drill: DrillConstants,
        amplitude: float,
    ) -> Percussion:
        """Return the percussion in the interval [s] since the last call; W was constant [N]."""
        mean = 0.5 * (self._position + position)
        velocity = (position - self._position) / interval
        force = weight_on_bit - drill.load_spring_rate * mean - drill.rpud_damping * velocity
        ratio = amplitude / self._nominal if self._nominal > 0.0 else 0.0
        share = interval / (interval + FORCE_WINDOW)
        self._mean_force += (force - self._mean_force) * share
        pulses = self._mean_pulses(interval, share, drill.in_rock)
        on_rock = self._mean_force + drill.free_mass * drill.gravity + drill.rpud_weight
        if not (drill.in_rock and on_rock > 0.0):
            on_rock = 0.0
        energies, self._energies = tuple(self._energies), array("d")
        for energy in energies:
            self.arrived += energy
        # The tip may be ahead of the nodal plane by the amplitude.
        reach = position + max(position - self._position, 0.0) + amplitude
        self._position = position
        forces = (force, on_rock, pulses)
        return Percussion(energies, ratio, drill.in_rock, *forces, drill.rpud_damping, reach)

    def _mean_pulses(self, interval: float, share: float, in_rock: bool) -> Pulses:
        """Let what struck the rock in the interval [s] join the means with a share."""
        struck = (float(len(self._impulses)), sum(self._impulses), sum(self._durations))
        self._impulses, self._durations = array("d"), array("d")
        if not in_rock:
            self._pulses = (0.0, 0.0, 0.0)
            return NO_PULSES
        rate, impulse, duration = self._pulses
        rate += (struck[0] / interval - rate) * share
        impulse += (struck[1] / interval - impulse) * share
        duration += (struck[2] / interval - duration) * share
        self._pulses = (rate, impulse, duration)
        if not (rate > 0.0 and impulse > 0.0 and duration > 0.0):
            return NO_PULSES
        return Pulses(rate, impulse / rate, duration / rate)


class LoadSpring:
    """Energy of the load spring between mount and RPUD, from step to step.

    Its force is k_1 (s - u_np), with s = W / k_1 the compression by mount and rock, and c_1 times
    the relative velocity. s changes at the steps alone, by the mount and by the hole. At time zero
    the arm has stored energy [J], and the load spring pushes with its rate [N/m].
    """

    def __init__(
        self, stored: float, compression: float, spring_rate: float, position: float
    ) -> None:
        self._compression = compression
        self._spring_rate = spring_rate
        self._first_stored = stored
        # Of the last step, until it is in the engine: distance of the origin past the bodies [m],
        # and the part of the preload that this takes [J].
        self._passed = self._left = 0.0
        self._first_preload = self._preload(position)
        self._changes = 0.0
        self._mount_work = 0.0
        self._penetration = 0.0
        self._withdrawal = 0.0
        # Forces of the current step by the velocity of the mount: of the damping, and all [N].
        self._damping_force = self._motion_force = 0.0
        self._damper = 0.0  # loss in the damping, up to the last step [J]
        self._motion_work = 0.0  # work of all these forces on the RPUD, up to the last step [J]
        self._start = position  # position of the nodal plane at the last step [m]

    def step(self, advance: Advance, spring_rate: float, position: float) -> None:
        before = self._compression
        change = spring_rate - self._spring_rate
        self._changes += change * before * (0.5 * before - position)
        after = advance.compression + advance.passed
        deeper = after - advance.moved
        self._penetration -= _work(spring_rate, position, before, deeper)
        self._mount_work += _work(spring_rate, position, deeper, after)
        self._compression, self._passed = advance.compression, advance.passed
        self._spring_rate, self._left = spring_rate, 0.0
        if advance.passed:
            self._left = _work(spring_rate, position, 0.0, after) - self._preload(position)
        self._damper -= 2.0 * self._damping_force * (position - self._start)
        self._motion_work += self._motion_force * (position - self._start)
        self._damper += advance.dragged
        self._start = position
        self.lead(advance)

    def lead(self, advance: Advance) -> None:
        """Take the forces of the step that begins."""
        self._damping_force = advance.damping_force
        self._motion_force = advance.damping_force + advance.lead_force

    def shift(self, distance: float, work: float) -> None:
        """Count positions from an origin that is further ahead, by work on the springs [J]."""
        self._start -= distance
        self._mount_work -= self._left - work
        self._withdrawal += work
        self._passed = self._left = 0.0

    def account(self, work: MountWork, position: float) -> FeedAccount:
        travel = position - self._start
        damper = self._damper - 2.0 * self._damping_force * travel
        motion_work = self._motion_work + self._motion_force * travel
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
        moved = position - self._passed
        return self._left + _work(self._spring_rate, moved, 0.0, self._compression)


def _work(spring_rate: float, position: float, start: float, end: float) -> float:
    """Return the work on the load spring while its other end goes from start to end [J]."""
    return spring_rate * (end - start) * (0.5 * (start + end) - position)
