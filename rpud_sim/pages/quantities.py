"""Table of the quantities that people see: name, unit, scale, colour, sign and axis of each.

Screens, pages and lines in a terminal show a quantity in this one form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

NONE = "\N{EN DASH}"  # in place of a value that is not there
_PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
# Units that are shown with a prefix; angles, and what has no unit, stay as they are.
_SCALED = ("m", "m/s", "N", "N s", "J", "W", "s", "V", "A", "Hz", "Pa", "C", "ohm", "F", "H")


@dataclass(frozen=True)
class ShownQuantity:
    """Quantity of a drill, and how it is shown; values are in SI units elsewhere."""

    name: str  # such as ``peak_force``
    label: str  # such as ``peak force``
    unit: str  # in which it is shown
    scale: float = 1.0  # from the SI unit to that one
    colour: str = "other"  # kind of quantity, which names its colour
    floor: float = 0.0  # SI; what is smaller reads 0
    types: str = ""  # of messages that have it, the best first; with the column of another name
    zero: bool = True  # whether its axis includes zero
    digits: int = 3  # significant ones

    @property
    def sources(self) -> list[str]:
        """``Type.column`` of messages that have it, the best first."""
        return [each if "." in each else f"{each}.{self.name}" for each in self.types.split()]

    def for_browser(self) -> dict[str, object]:
        """Return it as plain values, for the page's own script."""
        return {name: value for name, value in vars(self).items() if name != "types"}

    def text(self, value: float | None, *, unit: bool = True, sign: bool = False) -> str:
        """Return a value, given in SI units, as people read it; a dash for none.

        ``sign`` shows that of a positive value too.
        """
        if value is None or not math.isfinite(value):
            return NONE
        number = number_text(0.0 if abs(value) < self.floor else value * self.scale, self.digits)
        number = f"+{number}" if sign and value > 0.0 and number != "0" else number
        return f"{number} {self.unit}" if unit and self.unit else number


def number_text(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, and with all of them before the point."""
    if not math.isfinite(value):
        return NONE
    if not value:
        return "0"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:.{places}f}" if places <= 9 else f"{value:.{digits - 1}e}"
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


_TABLE = (
    ShownQuantity("impact_rate", "impacts", "/s", 1.0, "force", 1e-3),
    ShownQuantity("peak_force", "peak force", "kN", 1e-3, "force", 0.5, "ContactForce"),
    ShownQuantity("contact_force", "contact force", "kN", 1e-3, "force", 0.5),
    ShownQuantity("reacting_force", "load on the mount", "N", 1.0, "load", 1e-6,
                  "ReactingForce.force"),
    ShownQuantity("weight_on_bit", "weight on bit", "N", 1.0, "command", 1e-6, "Mount Status"),
    ShownQuantity("nodal_plane", "nodal plane", "mm", 1e3, "plane", 1e-12, "NodalPlane.position",
                  zero=False),
    ShownQuantity("actuator", "actuator tip", "mm", 1e3, "plane", 1e-12, zero=False),
    ShownQuantity("free_mass", "free mass", "mm", 1e3, "mass", 1e-12, zero=False),
    ShownQuantity("drill_tool", "drill tool", "mm", 1e3, "tool", 1e-12, "DrillTool.displacement",
                  zero=False),
    ShownQuantity("electrical_power", "electrical power", "W", 1.0, "power", 1e-6,
                  "ActuatorState Status"),
    ShownQuantity("actuator_power", "power of the vibration", "W", 1.0, "power", 1e-6, "Status"),
    ShownQuantity("absorbed_power", "power into tool and rock", "W", 1.0, "depth", 1e-6, "Status"),
    ShownQuantity("power", "power", "W", 1.0, "power", 1e-6),
    ShownQuantity("depth", "depth", "mm", 1e3, "depth", 1e-9, "Borehole Status"),
    ShownQuantity("penetration_rate", "penetration rate", "mm/min", 6e4, "depth", 1e-10,
                  "Borehole Status"),
    ShownQuantity("torque", "torque of rock and cuttings", "mN m", 1e3, "torque", 1e-9, "Rotation"),
    ShownQuantity("drive_torque", "torque of the drive", "mN m", 1e3, "power", 1e-9, "Rotation"),
    ShownQuantity("rotation_rate", "rotation", "rad/s", 1.0, "torque", 1e-6, "Rotation.rate"),
    ShownQuantity("mount_force", "force of the arm", "N", 1.0, "load", 1e-6, "Mount.force"),
    ShownQuantity("mount_position", "mount", "mm", 1e3, "plane", 1e-9,
                  "Mount.position", zero=False),
    ShownQuantity("feed", "feed", "mm", 1e3, "command", 1e-9, "Mount", zero=False),
    ShownQuantity("vibration_amplitude", "vibration", "µm", 1e6, "plane", 1e-12,
                  "Status ActuatorState.amplitude"),
    ShownQuantity("current", "current", "A", 1.0, "power", 1e-9, "ActuatorState"),
    ShownQuantity("drive_voltage", "voltage", "V", 1.0, "command", 1e-6,
                  "Status ActuatorState.voltage"),
    ShownQuantity("drive_frequency", "frequency of the drive", "kHz", 1e-3, "command", 1e-3,
                  "Status ActuatorState.frequency", zero=False),
    ShownQuantity("resonance_frequency", "resonance", "kHz", 1e-3, "plane", 1e-3,
                  "Status ActuatorState", zero=False),
    ShownQuantity("temperature", "temperature of the actuator", "K", 1.0, "fault", 0.0,
                  "Status.actuator_temperature ActuatorState", zero=False),
    ShownQuantity("packed_cuttings", "packed cuttings", "mm³", 1e9, "depth", 1e-13, "Borehole"),
    ShownQuantity("bit_wear", "wear of the bit", "", 1.0, "tool", 1e-9, "Borehole"),
    ShownQuantity("lateness", "latest block", "ms", 1e3, "other", 1e-6, "Status.lateness_max"),
    ShownQuantity("feed_rate", "rate of the feed", "mm/s", 1e3, "command", 1e-9),
    ShownQuantity("impact_interval", "interval between impacts", "ms", 1e3, "force", 1e-9),
    ShownQuantity("impact_velocity", "impact velocity", "m/s", 1.0, "mass", 1e-6),
    ShownQuantity("impact_energy", "energy of an impact", "mJ", 1e3, "force", 1e-9),
    ShownQuantity("contact_duration", "contact duration", "µs", 1e6, "force", 1e-9),
    ShownQuantity("impact_power", "power of the impacts", "W", 1.0, "power", 1e-6),
    ShownQuantity("weight_power", "power of weight on bit and gravity", "W", 1.0, "power", 1e-6),
    ShownQuantity("load_damper_power", "power lost in the load damper", "W", 1.0, "power", 1e-6),
    ShownQuantity("collision_power", "power lost in collisions", "W", 1.0, "power", 1e-6),
)  # fmt: skip
QUANTITIES = {quantity.name: quantity for quantity in _TABLE}


# How figures of a run are shown.
_FIGURES = {
    "drill_tool_impact_rate": "impact_rate",
    "actuator_impact_rate": "impact_rate",
    "squeezed_impact_rate": "impact_rate",
    "impact_velocity_mean": "impact_velocity",
    "contact_force_mean": "peak_force",
    "contact_force_p99": "peak_force",
    "contact_force_max": "peak_force",
    "contact_duration_mean": "contact_duration",
    "kinetic_energy_rate": "power",
    "energy_transferred_rate": "power",
    "energy_absorbed_rate": "power",
    "reacting_force_mean": "reacting_force",
    "depth": "depth",
    "penetration_rate": "penetration_rate",
}


def figure_quantity(name: str) -> ShownQuantity:
    """Return how a figure of a run is shown, by its name; its label is that name."""
    known = QUANTITIES.get(_FIGURES.get(name, ""), ShownQuantity("", "", ""))
    return replace(known, name=name, label=name)


def quantity_in(unit: str, greatest: float, label: str = "") -> ShownQuantity:
    """Return how a quantity outside the table is shown, such as a parameter.

    ``unit`` is its SI unit. ``greatest`` is its greatest size: it gets one to three digits before
    the point.
    """
    if unit == "kg" and 0.0 < greatest < 1.0:
        return ShownQuantity("", label, "g", 1e3)
    if unit not in _SCALED or not math.isfinite(greatest) or greatest <= 0.0:
        return ShownQuantity("", label, "/s" if unit == "1/s" else unit)
    exponent = min(max(3 * math.floor(math.log10(greatest) / 3.0 + 1e-12), -9), 9)
    exponent = min(exponent, 0) if unit == "s" else exponent
    return ShownQuantity("", label, _PREFIXES[exponent] + unit, 10.0**-exponent)


def for_browser() -> list[dict[str, object]]:
    """Return the table as plain values, for the page's own script."""
    return [quantity.for_browser() for quantity in QUANTITIES.values()]
