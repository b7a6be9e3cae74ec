"""Actuator: drive, generator and temperature; the engine computes the vibration that follows."""

from __future__ import annotations

import dataclasses
import math

from rpud_sim.foundation.quantities import (
    ParameterError,
    ParameterGroup,
    choice,
    flag,
    number,
    quantities,
)
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.model.elementary import complex_phase, complex_size, exponential_minus_one
from rpud_sim.model.resonator import Resonance, ResonatorEnergy
from rpud_sim.simulation.commands import Drive

# The temperature is computed, and a tracking generator sets its frequency, at whole multiples of
# these [ns]. Otherwise they would depend on how the simulation is stepped.
HEATING_INTERVAL = 10_000_000
TRACKING_INTERVAL = 1_000_000


@dataclasses.dataclass(frozen=True)
class ActuatorParameters(ParameterGroup):
    """Parameters of the actuator, in SI units.

    The paper gives none of them: the resonance frequency is its drive frequency, the others are
    assumed; docs/explanation/actuator.md explains why.
    """

    actuator_model: str = choice(
        "gain",
        ("gain", "resonance"),
        "gain: the amplitude is proportional to the voltage, without delay; "
        "resonance: by resonance, with ring-up and power",
    )
    nominal_voltage: float = number(
        100.0, "V", "voltage at which the vibration has its nominal amplitude", 1e-3, 1e3
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
    generator: str = choice(
        "fixed",
        ("fixed", "tracking"),
        "fixed: the frequency is the commanded one; tracking: it follows the resonance, so that "
        "the current is in phase with the voltage",
    )
    tracking_bandwidth: float = number(
        20.0, "Hz", "bandwidth in which a tracking generator follows the resonance", 0.1, 100.0
    )
    tracking_range: float = number(
        1000.0,
        "Hz",
        "greatest distance of a tracking generator from the commanded frequency",
        0.0,
        1e4,
        exclusive=True,
    )
    heating: bool = flag(False, "whether the actuator warms up and its resonance drifts")
    thermal_resistance: float = number(
        1.0, "K/W", "thermal resistance from the actuator to its surroundings", 1e-3, 1e3
    )
    heat_capacity: float = number(200.0, "J/K", "heat capacity of the actuator", 1e-3, 1e6)
    ambient_temperature: float = number(
        20.0, "degC", "temperature of the surroundings", -273.15, 150.0
    )
    resonance_temperature_coefficient: float = number(
        -2e-4, "1/K", "relative change of the resonance frequency with temperature", -1e-2, 1e-2
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.actuator_model != "resonance":
            if self.heating:
                raise ParameterError("heating = True needs actuator_model = resonance")
            if self.generator == "tracking":
                raise ParameterError("generator = tracking needs actuator_model = resonance")

    def modal_mass(self, vibration_amplitude: float) -> float:
        """Return the mass of the vibration at the tip [kg]; infinite with the gain model."""
        if self.actuator_model != "resonance" or vibration_amplitude == 0.0:
            return math.inf
        omega = 2.0 * math.pi * self.resonance_frequency
        velocity_per_volt = omega * vibration_amplitude / self.nominal_voltage
        square = velocity_per_volt * velocity_per_volt
        if square == 0.0:
            return math.inf
        return self.quality_factor / (omega * self.motional_resistance * square)


RESONANCE_FREQUENCY = quantities(ActuatorParameters)["resonance_frequency"]


@dataclasses.dataclass(frozen=True)
class ActuatorReading:
    """State of the actuator at one time, immutable.

    With the gain model all that follows from currents is NaN.
    """

    voltage: float  # amplitude of the voltage [V]
    frequency: float  # frequency of the voltage [Hz]
    amplitude: float  # amplitude of the vibration at the tip [m]
    # frequency at the current temperature, with its offset, without load [Hz]
    resonance_frequency: float
    temperature: float  # temperature at the last whole multiple of ``HEATING_INTERVAL`` [degC]
    current: float = math.nan  # amplitude of the current [A]
    phase: float = math.nan  # phase by which the current leads the voltage [rad]
    # drawn, averaged over a cycle [W]; negative where the vibration gives power back to the
    # drive
    electrical_power: float = math.nan
    electrical_energy: float = math.nan  # drawn since time zero [J]
    heat: float = math.nan  # heat since time zero [J]
    mechanical_work: float = math.nan  # work of the vibration on the bodies since time zero [J]
    stored: float = math.nan  # energy of the vibration [J]
    pending: float = math.nan  # work that the next update subtracts from the vibration [J]

    @property
    def impedance(self) -> float:
        """Magnitude of the impedance [ohm]; NaN without a current."""
        return self.voltage / self.current if self.current > 0.0 else math.nan


class Actuator:
    """Drive of the actuator, its generator and its temperature.

    With the gain model the amplitude follows the voltage immediately, at every frequency. With the
    resonance model the engine integrates the vibration (``rpud_sim.model.resonator``), and this
    object sets the voltage, the drive's frequency and the resonance frequency. Times are integer
    nanoseconds of simulation time. Every drive must have passed ``Configuration.check``; a
    frequency of zero at time zero is the resonance frequency. The vibration's amplitude [m] is at
    nominal voltage on resonance.
    """

    def __init__(
        self, parameters: ActuatorParameters, vibration_amplitude: float, drive: Drive
    ) -> None:
        self._parameters = parameters
        self._vibration_amplitude = vibration_amplitude
        self._voltage = drive.voltage if drive.enabled else 0.0
        self._commanded = drive.frequency or parameters.resonance_frequency
        self.frequency = self._commanded  # frequency of the drive [Hz], read-only
        self._tracking = parameters.generator == "tracking"
        self._locked = True
        self._pulled = 0.0  # shift by the generator's integrator [Hz]
        self._temperature = parameters.ambient_temperature
        self._offset = 0.0
        self._heat = 0.0  # heat up to the last change of the temperature [J]
        self._heating = HEATING_INTERVAL if parameters.heating else NEVER
        self._tuning = TRACKING_INTERVAL if self._tracking else NEVER
        self._decay_time = parameters.quality_factor / (math.pi * parameters.resonance_frequency)
        # constants of the engine's vibration at time zero; None with the gain model
        self.resonance: Resonance | None = None
        if parameters.actuator_model == "resonance":
            self.resonance = Resonance(
                self._decay_time,
                parameters.motional_resistance,
                vibration_amplitude / parameters.nominal_voltage,
                self._voltage,
                self.frequency,
                self.resonance_frequency,
            )

    @property
    def level(self) -> float:
        """What the engine gets: the voltage [V] of a resonance, else the amplitude [m]."""
        if self.resonance is not None:
            return self._voltage
        return self._vibration_amplitude * self._voltage / self._parameters.nominal_voltage

    @property
    def unloaded_amplitude(self) -> float:
        """Amplitude of a resonance without load at its resonance frequency [m]; 0 without one."""
        if self.resonance is None:
            return 0.0
        return self.resonance.amplitude_per_volt * self._voltage

    @property
    def next_step(self) -> int:
        """Time of the next step of temperature or generator [ns]; ``NEVER`` if there is none."""
        return min(self._heating, self._tuning)

    @property
    def resonance_frequency(self) -> float:
        """Resonance frequency at the current temperature, with its offset [Hz]."""
        coefficient = self._parameters.resonance_temperature_coefficient
        rise = self._temperature - self._parameters.ambient_temperature
        frequency = self._parameters.resonance_frequency * (1.0 + coefficient * rise)
        # The linear law holds for small changes; far beyond them the frequency stays positive.
        return _limited(frequency + self._offset)

    def read(
        self, amplitude: float, account: ResonatorEnergy, rotor: tuple[float, float] = (0.0, 0.0)
    ) -> ActuatorReading:
        """Return the state that belongs to the engine's amplitude [m] and its account.

        ``rotor`` is power [W] and energy [J] that the rotation draws as well, as a resistance does.
        """
        voltage, resonance = self._voltage, self.resonance_frequency
        if self.resonance is None:
            return ActuatorReading(
                voltage, self.frequency, self.level, resonance, self._temperature
            )
        resistance = self._parameters.motional_resistance
        power, energy = rotor
        envelope = account.envelope
        if voltage > 0.0:
            envelope += 2.0 * resistance * power / voltage
        return ActuatorReading(
            *(voltage, self.frequency, amplitude, resonance, self._temperature),
            current=complex_size(envelope) / resistance,
            phase=complex_phase(envelope),
            electrical_power=voltage * envelope.real / (2.0 * resistance),
            electrical_energy=account.drawn + energy,
            heat=account.heat,
            mechanical_work=account.work,
            stored=account.stored,
            pending=account.pending,
        )

    def step(self, time: int, account: ResonatorEnergy) -> None:
        """Take the steps that are due at a time [ns], not beyond ``next_step``."""
        if time == self._heating:
            self._warm(account.heat)
            self._heating += HEATING_INTERVAL
        if time == self._tuning:
            self._tune(account.envelope)
            self._tuning += TRACKING_INTERVAL

    def drive(self, drive: Drive) -> None:
        """Apply a drive; a frequency of zero keeps the current one."""
        self._voltage = drive.voltage if drive.enabled else 0.0
        if drive.frequency not in (0.0, self._commanded):
            self._commanded = drive.frequency
            self._run_free()

    def drift(self, offset: float) -> None:
        """Shift the resonance frequency by an offset [Hz]."""
        self._offset = offset

    def lock(self, locked: bool) -> None:
        """Let a tracking generator track, or run at the commanded frequency."""
        self._locked = locked
        if not locked:
            self._run_free()

    def _run_free(self) -> None:
        self._pulled = 0.0
        self.frequency = self._commanded

    def _tune(self, envelope: complex) -> None:
        """Follow the phase of the current; its lag by the decay time is compensated."""
        if not self._locked or self._voltage == 0.0 or envelope == 0.0:
            return
        # Below the resonance the current leads: its phase gives the detuning, in cycles per
        # decay time.
        bandwidth = self._parameters.tracking_bandwidth
        phase = complex_phase(envelope)
        step = bandwidth * phase * (TRACKING_INTERVAL / SECOND) / self._decay_time
        self._pulled = self._in_reach(self._pulled + step)
        pulled = self._in_reach(self._pulled + bandwidth * phase)
        self.frequency = _limited(self._commanded + pulled)

    def _in_reach(self, offset: float) -> float:
        greatest = self._parameters.tracking_range
        return min(max(offset, -greatest), greatest)

    def _warm(self, heat: float) -> None:
        """Set the temperature after one interval; the heat is that since time zero [J]."""
        parameters = self._parameters
        interval = HEATING_INTERVAL / SECOND
        power = (heat - self._heat) / interval
        end = parameters.ambient_temperature + parameters.thermal_resistance * power
        time_constant = parameters.thermal_resistance * parameters.heat_capacity
        share = -exponential_minus_one(-interval / time_constant)
        self._temperature += (end - self._temperature) * share
        self._heat = heat


def _limited(frequency: float) -> float:
    return min(max(frequency, RESONANCE_FREQUENCY.minimum), RESONANCE_FREQUENCY.maximum)
