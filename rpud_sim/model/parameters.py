"""Parameters of the drill: names, units, allowed ranges, and the paper's two tables."""

from __future__ import annotations

import dataclasses
import math
import reprlib
from collections.abc import Mapping
from typing import Any

REGIMES = ("free", "drilling")
CONTACT_MODELS = ("printed", "rayleigh")


class ParameterError(ValueError):
    """A parameter that cannot be used; its text names parameter, value, unit and allowed range."""


def shown(value: Any) -> str:
    """A value as text that is short and one line, whatever it is."""
    try:
        return reprlib.repr(value)
    except ValueError:  # an integer with more digits than Python writes
        return "a number too long to show"


@dataclasses.dataclass(frozen=True)
class Quantity:
    """What a number means and which values it may take.

    Args:
        unit: SI unit, empty for a pure number.
        description: one phrase, with the paper's symbol.
        minimum: least allowed value.
        maximum: greatest allowed value.
        exclusive: whether the minimum itself is forbidden.
        below: whether the maximum itself is forbidden.
    """

    unit: str
    description: str
    minimum: float
    maximum: float
    exclusive: bool = False
    below: bool = False

    @property
    def range(self) -> str:
        """The allowed range as text, for example ``(0, 100] kg``."""
        left = "(" if self.exclusive else "["
        right = ")" if self.below else "]"
        return f"{left}{self.minimum:g}, {self.maximum:g}{right} {self.unit}".rstrip()

    def check(self, name: str, value: Any) -> float:
        """Return the value as a float.

        Raises:
            ParameterError: if it is no finite number inside the range.
        """
        number = math.nan
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
        above = number > self.minimum if self.exclusive else number >= self.minimum
        under = number < self.maximum if self.below else number <= self.maximum
        if not (math.isfinite(number) and above and under):
            text = f"{number:g}" if isinstance(value, float) else shown(value)
            unit = f" {self.unit}" if self.unit else ""
            raise ParameterError(f"{name} = {text}{unit} is outside its range {self.range}")
        return number


def check_choice(name: str, value: Any, choices: tuple[str, ...]) -> str:
    """Return the value if it is one of the choices.

    Raises:
        ParameterError: if it is not.
    """
    if not (isinstance(value, str) and value in choices):
        raise ParameterError(f"{name} = {shown(value)} is not one of {', '.join(choices)}")
    return value


def _positive(unit: str, description: str, maximum: float, minimum: float = 0.0) -> Quantity:
    return Quantity(unit, description, minimum, maximum, exclusive=minimum == 0.0)


# Upper limits keep every closed form well inside the range of double precision; they are far beyond
# any drill of this kind.
QUANTITIES: Mapping[str, Quantity] = {
    "rpud_mass": _positive("kg", "mass of the RPUD, m_ud", 1e3),
    "vibration_frequency": _positive(
        "Hz", "frequency of the harmonic vibration, f_0", 2e5, minimum=100.0
    ),
    "vibration_amplitude": Quantity("m", "amplitude of the harmonic vibration, A_0", 0.0, 1e-3),
    "rpud_damping_ratio": Quantity("", "damping ratio of the RPUD, xi_ud", 0.0, 1.0, below=True),
    "load_spring_rate": _positive("N/m", "spring rate of the load spring, k_1", 1e7),
    "free_mass": _positive("kg", "mass of the free mass, m_fm", 10.0),
    "drill_tool_mass": _positive("kg", "mass of the drill tool before drilling, m_dt", 100.0),
    "drill_tool_damping_ratio": Quantity(
        "", "damping ratio of the drill tool before drilling, xi_dt", 0.0, 1.0, below=True
    ),
    "restoring_spring_rate": _positive("N/m", "spring rate of the restoring spring, k_2", 1e7),
    "actuator_restitution": Quantity(
        "", "coefficient of restitution between actuator and free mass, e_1", 0.0, 1.0
    ),
    "drill_tool_restitution": Quantity(
        "", "coefficient of restitution between free mass and drill tool, e_2", 0.0, 1.0
    ),
    "elastic_modulus": _positive("Pa", "elastic modulus of the drill tool, E_dt", 1e13),
    "section_1_length": _positive("m", "length of part I of the drill tool, L_dt1", 10.0),
    "section_1_area": _positive("m^2", "cross-sectional area of part I, A_dt1", 1.0),
    "section_2_length": _positive("m", "length of part II of the drill tool, L_dt2", 10.0),
    "section_2_area": _positive("m^2", "cross-sectional area of part II, A_dt2", 1.0),
    "drill_tool_density": _positive("kg/m^3", "density of the drill tool, rho_dt", 1e5),
    "weight_on_bit": Quantity("N", "weight on bit, preload of the load spring, W", 0.0, 1e3),
    "gravity": Quantity(
        "m/s^2", "acceleration of gravity along the drill axis, toward the rock, g", 0.0, 100.0
    ),
}


@dataclasses.dataclass(frozen=True)
class Parameters:
    """All parameters of the model, in SI units; the defaults are Table 2 of the paper.

    The paper leaves three values open or misprints them: Table 2 gives no weight on bit (10 N
    here), the elastic modulus is printed as 1.96e9 Pa (steel's 1.96e11 Pa here), and gravity is
    not given.

    Raises:
        ParameterError: if a value is outside the range in ``QUANTITIES``.
    """

    rpud_mass: float = 1.0
    vibration_frequency: float = 16000.0
    vibration_amplitude: float = 35e-6
    rpud_damping_ratio: float = 0.5
    load_spring_rate: float = 2000.0
    free_mass: float = 5e-3
    drill_tool_mass: float = 13.5e-3
    drill_tool_damping_ratio: float = 0.5
    restoring_spring_rate: float = 2000.0
    actuator_restitution: float = 1.0
    drill_tool_restitution: float = 1.0
    elastic_modulus: float = 1.96e11
    section_1_length: float = 10e-3
    section_1_area: float = 7.8e-5
    section_2_length: float = 80e-3
    section_2_area: float = 2.0e-5
    drill_tool_density: float = 7.9e3
    weight_on_bit: float = 10.0
    gravity: float = 9.81
    contact_model: str = "printed"
    regime: str = "drilling"

    def __post_init__(self) -> None:
        for name, quantity in QUANTITIES.items():
            object.__setattr__(self, name, quantity.check(name, getattr(self, name)))
        check_choice("contact_model", self.contact_model, CONTACT_MODELS)
        check_choice("regime", self.regime, REGIMES)

    def replace(self, **changes: Any) -> Parameters:
        """Return a copy with some values changed.

        Raises:
            ParameterError: if a name is unknown or a value is outside its range.
        """
        for name in changes:
            if name not in NAMES:
                raise ParameterError(f"{name} is not a parameter; known are {', '.join(NAMES)}")
        return dataclasses.replace(self, **changes)


NAMES: tuple[str, ...] = tuple(field.name for field in dataclasses.fields(Parameters))


def preset(regime: str) -> Parameters:
    """Return the paper's parameters for a regime.

    ``free`` is Table 1 (no weight on bit); ``drilling`` is Table 2 with 10 N.

    Raises:
        ParameterError: if the regime is unknown.
    """
    check_choice("regime", regime, REGIMES)
    weight_on_bit = 0.0 if regime == "free" else 10.0
    return Parameters(regime=regime, weight_on_bit=weight_on_bit)
