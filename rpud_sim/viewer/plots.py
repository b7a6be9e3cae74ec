"""Plots of a drill, in the right column of the screen."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from rpud_sim.pages.quantities import QUANTITIES

_BAND, _LINE, _STEPS = "band", "line", "steps"

# Identifier of a choice, its title, and its layers: quantity and kind.
_Choice = tuple[str, str, tuple[tuple[str, str], ...]]
_PLOTS: tuple[tuple[str, str, tuple[_Choice, ...]], ...] = (
    (
        "peak_force",
        "peak force of the impacts",
        (("", "", (("peak_force", _BAND), ("contact_force", _LINE))),),
    ),
    (
        "load",
        "load on the mount",
        (("", "", (("reacting_force", _BAND), ("weight_on_bit", _STEPS))),),
    ),
    (
        "motion",
        "motion",
        (("", "", (("actuator", _LINE), ("free_mass", _LINE), ("drill_tool", _LINE))),),
    ),
    (
        "more",
        "more",
        (
            ("depth", "depth of the hole", (("depth", _LINE),)),
            ("rate", "rate of penetration", (("penetration_rate", _LINE),)),
            (
                "power",
                "power, mean of a second",
                (
                    ("actuator_power", _LINE),
                    ("absorbed_power", _LINE),
                    ("electrical_power", _LINE),
                ),
            ),
            ("impacts", "impacts per second", (("impact_rate", _LINE),)),
            ("torque", "torque", (("torque", _BAND), ("drive_torque", _BAND))),
            ("rotation", "rotation", (("rotation_rate", _BAND),)),
            ("feed", "feed and mount", (("feed", _BAND), ("mount_position", _BAND))),
            ("arm", "force of the arm on the mount", (("mount_force", _BAND),)),
            ("positions", "positions", (("nodal_plane", _BAND), ("drill_tool", _BAND))),
            ("voltage", "voltage of the drive", (("drive_voltage", _STEPS),)),
            (
                "frequency",
                "drive and resonance",
                (("drive_frequency", _STEPS), ("resonance_frequency", _LINE)),
            ),
            ("current", "current of the actuator", (("current", _LINE),)),
            ("vibration", "amplitude of the vibration", (("vibration_amplitude", _LINE),)),
            ("temperature", "temperature of the actuator", (("temperature", _LINE),)),
            ("cuttings", "cuttings in the flutes", (("packed_cuttings", _LINE),)),
            ("wear", "wear of the bit", (("bit_wear", _LINE),)),
            ("lateness", "how late the latest block was", (("lateness", _LINE),)),
        ),
    ),
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
        shown = [_choice(*choice, has) for choice in choices]
        shown = [choice for choice in shown if choice["layers"]]
        if name == "more":
            shown += others
        if shown:
            plots.append({"id": name, "title": title, "choices": shown})
    return plots


def _choice(
    name: str, title: str, layers: tuple[tuple[str, str], ...], has: Callable[[str], bool]
) -> dict[str, Any]:
    found = [
        {"quantity": quantity, "label": QUANTITIES[quantity].label, "kind": kind}
        for quantity, kind in layers
        if has(quantity)
    ]
    return {"id": name, "title": title, "layers": found}


def chosen_quantities(plots: Collection[dict[str, Any]], choices: Any) -> dict[str, str]:
    """Return kinds of layers by the quantity that is shown, with these choices by plot."""
    found = {}
    for plot in plots:
        wanted = choices.get(plot["id"])
        options = plot["choices"]
        choice = next((each for each in options if each["id"] == wanted), options[0])
        for layer in choice["layers"]:
            if layer["kind"] == _BAND or layer["quantity"] not in found:
                found[layer["quantity"]] = layer["kind"]
    return found
