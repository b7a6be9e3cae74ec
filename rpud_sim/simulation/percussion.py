"""Percussion as the slow processes see it: sums over the time since their last step."""

from __future__ import annotations

from array import array

import numpy as np

from rpud_sim.drilling.inputs import Percussion
from rpud_sim.model.compile import reader_of
from rpud_sim.model.drill import Drill
from rpud_sim.model.elementary import exponential, sin_cos, sin_cos_cycles
from rpud_sim.model.segment import SEGMENT

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
    position: float = offset + exponential(-decay * elapsed) * (
        cosine * turned_cosine + sine * turned_sine
    )
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
        self._energies = array("d")
        self.arrived = 0.0  # energy of all impacts [J]

    def shift(self, way: float) -> None:
        """Count positions from an origin that is further ahead."""
        self._position -= way

    def add(self, impacts: np.ndarray) -> None:
        """Add ``IMPACT`` records of impacts that have ended."""
        self._energies.extend(impacts["energy_transferred"].tolist())

    def read(
        self,
        interval: float,
        position: float,
        weight_on_bit: float,
        drill: Drill,
        amplitude: float,
    ) -> Percussion:
        """Return the percussion since the last call.

        Args:
            interval: since the last call [s].
            weight_on_bit: W since the last call [N].
        """
        mean = 0.5 * (self._position + position)
        velocity = (position - self._position) / interval
        force = weight_on_bit - drill.load_spring_rate * mean - drill.rpud_damping * velocity
        ratio = amplitude / self._nominal if self._nominal > 0.0 else 0.0
        self._mean_force += (force - self._mean_force) * interval / (interval + FORCE_WINDOW)
        on_rock = self._mean_force + drill.free_mass * drill.gravity + drill.rpud_weight
        if not (drill.in_rock and on_rock > 0.0):
            on_rock = 0.0
        energies, self._energies = tuple(self._energies), array("d")
        for energy in energies:
            self.arrived += energy
        reach = position + max(position - self._position, 0.0)
        self._position = position
        return Percussion(energies, ratio, drill.in_rock, force, on_rock, drill.rpud_damping, reach)
