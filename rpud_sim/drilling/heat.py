"""Heat: temperature of a body that takes up power and gives heat to its surroundings."""

from __future__ import annotations

import math


class WarmBody:
    """Temperature of a body with one heat capacity and one thermal resistance.

        C dT/dt = P - (T - T_ambient) / R

    During a step the power is constant, and the temperature an exponential.

    Args:
        thermal_resistance: to the surroundings [K/W].
        ambient_temperature: of the surroundings, and of the body at first [K].
    """

    def __init__(self, thermal_resistance: float, ambient_temperature: float) -> None:
        self._resistance = thermal_resistance
        self._ambient = ambient_temperature
        self.temperature = ambient_temperature  # of the body [K]
        self._share_of = (0.0, 0.0)  # interval [s] and heat capacity [J/K] of the last step
        self._share = 0.0

    def step(self, interval: float, heat: float, heat_capacity: float) -> None:
        """Warm or cool during a step.

        Args:
            interval: its length, above 0 [s].
            heat: that comes in [J].
            heat_capacity: of the body [J/K].
        """
        end = self._ambient + self._resistance * heat / interval
        if self._share_of != (interval, heat_capacity):
            self._share_of = (interval, heat_capacity)
            self._share = -math.expm1(-interval / (self._resistance * heat_capacity))
        self.temperature += (end - self.temperature) * self._share
