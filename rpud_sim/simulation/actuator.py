"""Actuator: from the voltage on the piezoelectric stack to the amplitude of the vibration."""

from __future__ import annotations

import cmath
import dataclasses
import math

from rpud_sim.foundation.parameters import ParameterGroup, choice, flag, number, quantities
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.simulation.commands import Drive

# The temperature is computed at whole multiples of this [ns]. Otherwise it would depend on how the
# simulation is stepped.
HEATING_INTERVAL = 10_000_000

# A step changes the amplitude by at most STEP of its greatest. It lasts at least one cycle and
# SHORTEST_STEP of the time constant; otherwise steps far from resonance would be too many.
STEP = 0.01
SHORTEST_STEP = 0.002

# The amplitude is steady when its distance from its end is below STEADY of its greatest, or the
# envelope is within SMALLEST_VOLTAGE [V] of its end, where rounding ends the approach.
STEADY = 0.001
SMALLEST_VOLTAGE = 1e-9


@dataclasses.dataclass(frozen=True)
class ActuatorParameters(ParameterGroup):
    """Parameters of the actuator, in SI units.

    The paper gives none of them: the resonance frequency is that of its drive, the others are
    assumed; docs/explanation/actuator.md says why.

    Raises:
        ParameterError: if a value is outside its range, or if the actuator is to heat without the
            power that its resonance model gives.
    """

    actuator_model: str = choice(
        "gain",
        ("gain", "resonance"),
        "gain: the amplitude is proportional to the voltage at once; "
        "resonance: by resonance, with ring-up and power",
    )
    nominal_voltage: float = number(
        100.0,
        "V",
        "voltage at which the vibration has its nominal amplitude",
        0.0,
        1e3,
        exclusive=True,
    )
    resonance_frequency: float = number(
        16000.0, "Hz", "resonance frequency of the actuator at ambient temperature", 100.0, 2e5
    )
    quality_factor: float = number(
        500.0, "", "quality factor of the actuator's resonance", 10.0, 1e5
    )
    motional_resistance: float = number(
        100.0, "ohm", "electrical resistance of the actuator on resonance", 1e-3, 1e6
    )
    heating: bool = flag(False, "whether the actuator warms up and its resonance drifts")
    thermal_resistance: float = number(
        1.0, "K/W", "thermal resistance from the actuator to its surroundings", 1e-3, 1e3
    )
    heat_capacity: float = number(200.0, "J/K", "heat capacity of the actuator", 1e-3, 1e6)
    ambient_temperature: float = number(
        293.15, "K", "temperature of the surroundings", 0.0, 1e3, exclusive=True
    )
    resonance_temperature_coefficient: float = number(
        -2e-4, "1/K", "relative change of the resonance frequency with temperature", -1e-2, 1e-2
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.heating and self.actuator_model != "resonance":
            raise ParameterError("heating = True needs actuator_model = resonance")


RESONANCE_FREQUENCY = quantities(ActuatorParameters)["resonance_frequency"]


class Actuator:
    """Amplitude of the vibration under drives, and the power that they take.

    The gain model follows the voltage at once, at every frequency. The resonance model is the
    motional branch of the Butterworth-Van Dyke circuit seen through its envelope z(t), the complex
    voltage across the motional resistance R, which changes by

        dz/dt = (V - (1 + j delta) z) / tau,  tau = Q / (pi f_r),  delta = 2 Q (f - f_r) / f_r

    The amplitude is proportional to abs(z), the power drawn is V Re(z) / 2 R and the heat abs(z)^2
    / 2 R. Impacts do not load the branch. The amplitude changes in steps, which depend on the
    drives and their times alone, not on the calls of ``advance_to``. Times are integer
    nanoseconds of simulation time.

    Every drive must have passed ``Configuration.check_drive``.

    Args:
        parameters: of the actuator.
        vibration_amplitude: at nominal voltage on resonance [m].
        drive: in force from time zero on; a frequency of zero is the resonance frequency.
    """

    def __init__(
        self, parameters: ActuatorParameters, vibration_amplitude: float, drive: Drive
    ) -> None:
        self._parameters = parameters
        self._vibration_amplitude = vibration_amplitude
        self._resonant = parameters.actuator_model == "resonance"
        self._time = 0
        self._voltage = drive.voltage if drive.enabled else 0.0
        self._frequency = drive.frequency or parameters.resonance_frequency
        self._temperature = parameters.ambient_temperature
        self._offset = 0.0
        # Time and value of the envelope at its last change of course, and heat of this interval.
        self._since = 0
        self._envelope = 0j
        self._heat = 0.0
        self._heating = HEATING_INTERVAL if parameters.heating else NEVER
        self._amplitude = 0.0
        self._begin()

    @property
    def amplitude(self) -> float:
        """Amplitude of the vibration, constant between steps [m]."""
        return self._amplitude

    @property
    def frequency(self) -> float:
        """Frequency of the vibration, that of the drive [Hz]; kept while ringing down."""
        return self._frequency

    @property
    def next_step(self) -> int:
        """Time before which the amplitude stays the same [ns]; ``NEVER`` if it is steady."""
        idle = self._voltage == 0.0 and self._envelope == 0j
        return self._step if idle else min(self._step, self._heating)

    @property
    def resonance_frequency(self) -> float:
        """Resonance frequency at the present temperature, with its offset [Hz]."""
        coefficient = self._parameters.resonance_temperature_coefficient
        rise = self._temperature - self._parameters.ambient_temperature
        frequency = self._parameters.resonance_frequency * (1.0 + coefficient * rise)
        # The linear law holds for small changes; far beyond them the frequency stays positive.
        allowed = RESONANCE_FREQUENCY
        return min(max(frequency + self._offset, allowed.minimum), allowed.maximum)

    @property
    def temperature(self) -> float:
        """Temperature at the last whole multiple of ``HEATING_INTERVAL`` [K]."""
        return self._temperature

    @property
    def electrical_power(self) -> float:
        """Power drawn, averaged over a cycle [W]; NaN with the gain model, which has none.

        It is negative where the vibration gives power back to the drive.
        """
        if not self._resonant:
            return math.nan
        envelope, _ = self._at(self._time)
        return self._voltage * envelope.real / (2.0 * self._parameters.motional_resistance)

    @property
    def energy_drawn(self) -> float:
        """Electrical energy drawn since time zero [J]; NaN with the gain model, which has none."""
        return math.nan

    def advance_to(self, time: int) -> None:
        """Advance to a time [ns], not before the present one, over all steps until then."""
        while (event := min(self._step, self._heating)) <= time:
            self._rebase(event)
            if event == self._heating:
                self._warm()
                self._heating += HEATING_INTERVAL
            self._follow()
        self._time = time

    def drive(self, time: int, drive: Drive) -> None:
        """Advance to a time [ns] and put a drive into force; the amplitude goes on from its own.

        A frequency of zero keeps the present one. A drive that changes nothing has no effect.
        """
        self.advance_to(time)
        voltage = drive.voltage if drive.enabled else 0.0
        frequency = drive.frequency or self._frequency
        if (voltage, frequency) != (self._voltage, self._frequency):
            self._rebase(time)
            self._voltage, self._frequency = voltage, frequency
            self._begin()

    def drift(self, time: int, offset: float) -> None:
        """Advance to a time [ns] and shift the resonance frequency by an offset [Hz]."""
        self.advance_to(time)
        if offset != self._offset:
            self._rebase(time)
            self._offset = offset
            self._begin()

    def _begin(self) -> None:
        """Go on from the present envelope under a new drive or resonance."""
        self._tune()
        if not self._resonant:
            self._envelope = self._end
        self._scale = max(abs(self._envelope), abs(self._end))
        # A step that is due now: the amplitude follows even if the envelope is at its end already.
        self._step = self._since
        self._follow()

    def _tune(self) -> None:
        """Set the course of the envelope, to the end that drive and resonance give."""
        resonance = self.resonance_frequency
        quality = self._parameters.quality_factor
        detuning = 2.0 * quality * (self._frequency - resonance) / resonance
        self._decay = math.pi * resonance / quality  # 1 / tau [1/s]
        self._rate = self._decay * complex(1.0, detuning)
        self._end = complex(self._voltage)
        if self._resonant:
            self._end /= complex(1.0, detuning)

    def _at(self, time: int) -> tuple[complex, float]:
        """Return the envelope [V] at a time on this course, and the heat [J] since its start."""
        elapsed = (time - self._since) / SECOND
        end, away = self._end, self._envelope - self._end
        decayed = cmath.exp(-self._rate * elapsed)
        area = away * (1.0 - decayed) / self._rate
        square = abs(away) ** 2 * -math.expm1(-2.0 * self._decay * elapsed) / (2.0 * self._decay)
        heat = abs(end) ** 2 * elapsed + 2.0 * (end.conjugate() * area).real + square
        return end + away * decayed, heat / (2.0 * self._parameters.motional_resistance)

    def _rebase(self, time: int) -> None:
        """Let the course start at a time."""
        self._envelope, heat = self._at(time)
        self._heat += heat
        self._since = time

    def _warm(self) -> None:
        """Set the temperature after the heat of one interval."""
        parameters = self._parameters
        interval = HEATING_INTERVAL / SECOND
        end = parameters.ambient_temperature + parameters.thermal_resistance * self._heat / interval
        time_constant = parameters.thermal_resistance * parameters.heat_capacity
        self._temperature -= (end - self._temperature) * math.expm1(-interval / time_constant)
        self._heat = 0.0
        self._tune()

    def _follow(self) -> None:
        """Set the amplitude of the present envelope if a step is due, and plan the next one."""
        away = abs(self._envelope - self._end)
        if away <= max(STEADY * self._scale, SMALLEST_VOLTAGE):
            self._envelope = self._end
            self._scale = abs(self._end)
            taken = self._amplitude_of(self._end)
            # A slow drift of the end makes steps as well.
            if self._step != NEVER or abs(taken - self._amplitude) > STEADY * taken:
                self._amplitude = taken
            self._step = NEVER
        elif self._step in (NEVER, self._since):
            self._amplitude = self._amplitude_of(self._envelope)
            # An envelope that rings down does not beat.
            rate = abs(self._rate) if self._end else self._decay
            shortest = max(SHORTEST_STEP / self._decay, 1.0 / self._frequency)
            duration = max(STEP * self._scale / (rate * away), shortest)
            self._step = self._since + math.ceil(duration * SECOND)

    def _amplitude_of(self, envelope: complex) -> float:
        return self._vibration_amplitude * abs(envelope) / self._parameters.nominal_voltage
