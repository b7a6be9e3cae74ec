"""Quantities as people see them: screens, pages and lines in a terminal show each in one form."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from rpud_sim.foundation.units import PREFIXES, UNITS, Unit

# Greatest credible size by SI unit: what is greater is garbage, such as of a faulty channel.
_CREDIBLE = {
    "N": 1e6,
    "m": 1e2,
    "m/s": 1e3,
    "1/s": 1e6,
    "W": 1e7,
    "N m": 1e5,
    "rad/s": 1e5,
    "V": 1e6,
    "A": 1e5,
    "Hz": 1e9,
    "degC": 1e5,
    "J": 1e6,
    "s": 1e9,
    "m^3": 1.0,
}
NONE = "\N{EN DASH}"  # instead of a value that is not there
GARBAGE = "garbage"  # instead of a value that nothing real has
# Units that are shown with a prefix; angles, and what has no unit, stay as they are.
_SCALED = ("m", "m/s", "N", "N s", "J", "W", "s", "V", "A", "Hz", "Pa", "C", "ohm", "F", "H")


@dataclasses.dataclass(frozen=True)
class ShownQuantity:
    """Quantity of a drill, and how it is shown; values are in SI units elsewhere."""

    name: str  # such as ``peak_force``
    label: str  # such as ``peak force``
    unit: str  # unit in which it is shown
    scale: float = 1.0  # factor from the SI unit to that one
    colour: str = "other"  # kind of quantity, which names its colour
    floor: float = 0.0  # SI; what is smaller reads 0
    # types of messages that have it, the best first; with the column of another name
    types: str = ""
    zero: bool = True  # whether its axis includes zero
    kind: str = "line"  # how a plot draws it; a ``band`` changes faster than a screen shows

    @property
    def si(self) -> str:
        """SI unit; empty for a pure number."""
        return UNITS.get(self.unit, Unit(self.unit)).si

    @property
    def credible(self) -> float:
        """Greatest credible size, in its SI unit."""
        return _CREDIBLE.get(self.si, 1e100)

    @property
    def sources(self) -> list[str]:
        """``Type.column`` of messages that have it, the best first."""
        return [each if "." in each else f"{each}.{self.name}" for each in self.types.split()]

    def for_browser(self) -> dict[str, object]:
        """Return it as plain values, for the page's own script."""
        plain = {name: value for name, value in vars(self).items() if name != "types"}
        return plain | {"credible": self.credible}

    def text(self, value: float | None, *, unit: bool = True, sign: bool = False) -> str:
        """Return a value, given in SI units, as people read it; a dash for none.

        ``sign`` shows the plus sign of a positive value.
        """
        if value is None or not math.isfinite(value):
            return NONE
        if abs(value) > self.credible:
            return GARBAGE
        number = number_text(0.0 if abs(value) < self.floor else value * self.scale)
        number = f"+{number}" if sign and value > 0.0 and number != "0" else number
        return f"{number} {self.unit}" if unit and self.unit else number


def _exponent(value: float) -> int:
    """Return the power of ten of a number's first digit."""
    return int(f"{value:e}".partition("e")[2])


def number_text(value: float) -> str:
    """Return a number with three significant digits, and with all of them before the point.

    One of more than nine digits before the point has an exponent.
    """
    if not math.isfinite(value):
        return NONE
    if not value:
        return "0"
    places = max(0, 2 - _exponent(value))
    text = f"{value:.{places}f}" if places <= 9 and abs(value) < 1e9 else f"{value:.2e}"
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


# Name, label, unit, colour, floor, whether any axis will do or one with zero, kind of its layer in
# a plot if it is not a line, and messages that have it.
_TABLE = """\
impact_rate | impacts | /s | force | 1e-3 | | |
peak_force | peak force | kN | force | 0.5 | | band | ContactForce
contact_force | contact force | kN | force | 0.5 | | |
reacting_force | reacting force | N | load | 1e-6 | | band | ReactingForce.force
weight_on_bit | weight on bit | N | command | 1e-6 | | steps | Mount Status
nodal_plane | nodal plane | mm | plane | 1e-8 | any | band | NodalPlane.position
actuator | actuator tip | mm | plane | 1e-8 | any | |
free_mass | free mass | mm | mass | 1e-8 | any | |
drill_tool | drill tool | mm | tool | 1e-8 | any | band | DrillTool.displacement
electrical_power | electrical power | W | power | 1e-6 | | | ActuatorState Status
actuator_power | power of the vibration | W | power | 1e-6 | | | Power
absorbed_power | power into tool and rock | W | depth | 1e-6 | | | Power
power | power | W | power | 1e-6 | | |
depth | depth | mm | depth | 1e-9 | any | | Borehole Status
penetration_rate | penetration rate | mm/min | depth | 1e-10 | | | Borehole Status
torque | torque of rock and cuttings | mN m | torque | 1e-9 | | band | Rotation
drive_torque | torque of the drive | mN m | power | 1e-9 | | band | Rotation
rotation_rate | rotation | rad/s | torque | 1e-6 | | band | Rotation.rate
mount_force | force of the arm | N | load | 1e-6 | | band | Mount.force
mount_position | mount | mm | plane | 1e-9 | any | band | Mount.position
feed | feed | mm | command | 1e-9 | any | band | Mount
vibration_amplitude | vibration | µm | plane | 1e-12 | | | Status ActuatorState.amplitude
current | current | A | power | 1e-9 | | | ActuatorState
drive_voltage | voltage | V | command | 1e-6 | | steps | Status ActuatorState.voltage
drive_frequency | drive frequency | kHz | command | 1e-3 |any|steps| Status ActuatorState.frequency
resonance_frequency | resonance | kHz | plane | 1e-3 | any | | Status ActuatorState
temperature | stack temperature | °C | fault | 0 | any | | Status.actuator_temperature ActuatorState
packed_cuttings | packed cuttings | mm³ | depth | 1e-13 | | | Borehole
bit_wear | wear of the bit | | tool | 1e-9 | | | Borehole
lateness | latest block | ms | other | 1e-6 | | | Timing.lateness_max
feed_rate | rate of the feed | mm/s | command | 1e-9 | | |
impact_interval | impact interval | ms | force | 1e-9 | | |
impact_velocity | impact velocity | m/s | mass | 1e-6 | | |
impact_energy | impact energy | mJ | force | 1e-9 | | |
contact_duration | contact duration | µs | force | 1e-9 | | |
impact_power | power of the impacts | W | power | 1e-6 | | |
weight_power | power of weight on bit and gravity | W | power | 1e-6 | | |
load_damper_power | power lost in the load damper | W | power | 1e-6 | | |
collision_power | power lost in collisions | W | power | 1e-6 | | |
"""


def _row(text: str) -> ShownQuantity:
    name, label, unit, *more, axis, kind, types = (word.strip() for word in text.split("|"))
    (colour, floor), of = more, UNITS[unit]
    given = name, label, unit, of.down / of.up, colour, float(floor), types
    return ShownQuantity(*given, zero=not axis, kind=kind or "line")


QUANTITIES: Mapping[str, ShownQuantity] = {
    quantity.name: quantity for quantity in map(_row, _TABLE.splitlines())
}
# Quantity of each metric of a run; none for a number of events.
_METRICS = {
    "events": "",
    "drill_tool_impact_rate": "impact_rate",
    "actuator_impact_rate": "impact_rate",
    "impact_velocity_mean": "impact_velocity",
    "contact_force_mean": "peak_force",
    "contact_force_p99": "peak_force",
    "contact_force_max": "peak_force",
    "contact_duration_mean": "contact_duration",
    "squeezed_impact_rate": "impact_rate",
    "kinetic_energy_rate": "power",
    "energy_transferred_rate": "power",
    "energy_absorbed_rate": "power",
    "reacting_force_mean": "reacting_force",
    "depth": "depth",
    "penetration_rate": "penetration_rate",
}
# Their SI units; empty without one.
METRIC_UNITS: Mapping[str, str] = {
    name: QUANTITIES[quantity].si if quantity else "" for name, quantity in _METRICS.items()
}


def quantity_in(unit: str, greatest: float) -> ShownQuantity:
    """Return how a quantity outside the table is shown, such as a parameter.

    ``unit`` is its SI unit. ``greatest`` is its greatest size: it gets one to three digits before
    the point.
    """
    if unit == "kg" and 0.0 < greatest < 1.0:
        return ShownQuantity("", "", "g", 1e3)
    if unit not in _SCALED or not math.isfinite(greatest) or greatest <= 0.0:
        return ShownQuantity("", "", "/s" if unit == "1/s" else unit)
    exponent = min(max(_exponent(greatest) // 3, -3), 0 if unit == "s" else 3)
    prefix = "nµm kMG"[exponent + 3].strip()
    up, down = PREFIXES[prefix]
    return ShownQuantity("", "", prefix + unit, down / up)


def for_browser() -> list[dict[str, object]]:
    """Return the table as plain values, for the page's own script."""
    return [quantity.for_browser() for quantity in QUANTITIES.values()]
