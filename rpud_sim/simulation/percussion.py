"""Percussion as the slow processes see it: sums over the time since their last step."""

from __future__ import annotations

import numpy as np

from rpud_sim.drilling.inputs import Percussion
from rpud_sim.drilling.process import PROCESS_INTERVAL
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.drill import Drill
from rpud_sim.model.elementary import exponential, sin_cos, sin_cos_cycles
from rpud_sim.model.segment import SEGMENT
from rpud_sim.simulation.record_fields import reader_of

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
    """Impacts and reacting force since the last step of the slow processes.

    The mean of R = W - k_1 u_np - c_1 v_np takes u_np as linear in the step: its period on the load
    spring is a hundred times as long.
    """

    def __init__(self, vibration_amplitude: float, position: float) -> None:
        self._nominal = vibration_amplitude
        self._position = position
        self._impacts = 0
        self._energy = 0.0

    def add(self, impacts: np.ndarray) -> None:
        """Add ``IMPACT`` records; the sum does not depend on how calls divide them."""
        self._impacts += len(impacts)
        for energy in impacts["energy_transferred"].tolist():
            self._energy += energy

    def read(
        self, position: float, weight_on_bit: float, drill: Drill, amplitude: float
    ) -> Percussion:
        """Return the percussion since the last call.

        Args:
            weight_on_bit: W since the last call [N].
        """
        mean = 0.5 * (self._position + position)
        velocity = (position - self._position) * SECOND / PROCESS_INTERVAL
        force = weight_on_bit - drill.load_spring_rate * mean - drill.rpud_damping * velocity
        ratio = amplitude / self._nominal if self._nominal > 0.0 else 0.0
        percussion = Percussion(self._impacts, self._energy, ratio, drill.in_rock, force)
        self._position = position
        self._impacts = 0
        self._energy = 0.0
        return percussion
