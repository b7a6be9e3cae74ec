"""Plots of a drill, in the right column of the screen."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from rpud_sim.pages.quantities import QUANTITIES

_STEPS = ("weight_on_bit", "drive_voltage", "drive_frequency")
_BANDS = (  # quantities that change faster than a screen shows
    *("peak_force", "reacting_force", "mount_force", "torque", "drive_torque", "rotation_rate"),
    *("feed", "mount_position", "nodal_plane", "drill_tool"),
)
# Choices of the last plot: title and quantities by identifier.
_MORE = {
    "depth": ("depth of the hole", "depth"),
    "rate": ("rate of penetration", "penetration_rate"),
    "power": ("power, mean of a second", "actuator_power", "absorbed_power", "electrical_power"),
    "impacts": ("impacts per second", "impact_rate"),
    "torque": ("torque", "torque", "drive_torque"),
    "rotation": ("rotation", "rotation_rate"),
    "feed": ("feed and mount", "feed", "mount_position"),
    "arm": ("force of the arm on the mount", "mount_force"),
    "positions": ("positions", "nodal_plane", "drill_tool"),
    "voltage": ("voltage of the drive", "drive_voltage"),
    "frequency": ("drive and resonance", "drive_frequency", "resonance_frequency"),
    "current": ("current of the actuator", "current"),
    "vibration": ("amplitude of the vibration", "vibration_amplitude"),
    "temperature": ("temperature of the actuator", "temperature"),
    "cuttings": ("cuttings in the flutes", "packed_cuttings"),
    "wear": ("wear of the bit", "bit_wear"),
    "lateness": ("how late the latest block was", "lateness"),
}
# Identifier and title of each plot, and its choices.
_PLOTS = (
    ("peak_force", "peak force of the impacts", {"": ("", "peak_force", "contact_force")}),
    ("load", "load on the mount", {"": ("", "reacting_force", "weight_on_bit")}),
    ("motion", "motion", {"": ("", "actuator", "free_mass", "drill_tool")}),
    ("more", "more", _MORE),
)


def drill_plots(
    has: Callable[[str], bool], others: Collection[dict[str, Any]] = ()
) -> list[dict[str, Any]]:
    """Return the plots of a drill as a frame has them.

    ``has`` says of a quantity whether there is any of it; ``others`` are further choices of the
    last plot.
    """
    plots = []
    for name, title, choices in _PLOTS:
        shown = [_choice(each, *choice, has=has) for each, choice in choices.items()]
        shown = [choice for choice in shown if choice["layers"]]
        if name == "more":
            shown += others
        if shown:
            plots.append({"id": name, "title": title, "choices": shown})
    return plots


def _choice(name: str, title: str, *quantities: str, has: Callable[[str], bool]) -> dict[str, Any]:
    layers = [
        {"quantity": each, "label": QUANTITIES[each].label, "kind": _kind(each)}
        for each in filter(has, quantities)
    ]
    return {"id": name, "title": title, "layers": layers}


def _kind(quantity: str) -> str:
    return "steps" if quantity in _STEPS else "band" if quantity in _BANDS else "line"


def chosen_quantities(plots: Collection[dict[str, Any]], choices: Any) -> dict[str, str]:
    """Return kinds of layers by the quantity that is shown, with these choices by plot.

    The plot of the motion is drawn from sections.
    """
    found: dict[str, str] = {}
    for plot in plots:
        if plot["id"] == "motion":
            continue
        wanted = choices.get(plot["id"])
        options = plot["choices"]
        choice = next((each for each in options if each["id"] == wanted), options[0])
        found |= {layer["quantity"]: layer["kind"] for layer in choice["layers"]}
    return found
