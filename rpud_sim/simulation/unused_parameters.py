"""Parameters that have no effect in the chosen models, and values that are probably mistakes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rpud_sim.simulation.configuration import PARAMETERS, Configuration, Settings

# Greatest ratio of free mass to RPUD mass; the paper's masses are 2 g and 1 kg.
_MOST_FREE_MASS = 0.1


def _uses_rock(drill: Configuration) -> bool:
    return drill.layers is not None or drill.rock.rock_model != "none"


# Names or beginnings of names, what they need, and whether a drill has it.
_NEEDS: tuple[tuple[tuple[str, ...], str, Callable[[Configuration], bool]], ...] = (
    (("weight_on_bit",), "feed_model = none", lambda d: not d.has_feed),
    (
        ("initial_feed", "feed_minimum", "feed_maximum", "feed_rate_limit", "contact_release"),
        "feed_model = arm or given",
        lambda d: d.has_feed,
    ),
    (("arm_", "anchoring_force"), "feed_model = arm", lambda d: d.mount.feed_model == "arm"),
    (("rotor_",), "a rotation_model", lambda d: d.rotates),
    (("bit_", "flute_", "cuttings_"), "a rotation_model and rock", lambda d: d.layers is not None),
    (("rock_energy_transfer", "hole_area"), "a rock_model or strata", _uses_rock),
    (
        ("rock_specific_energy",),
        "a rock_model, and no strata",
        lambda d: d.rock.rock_model != "none" and d.strata.found is None,
    ),
    (
        ("quality_factor", "motional_resistance", "generator"),
        "actuator_model = resonance",
        lambda d: d.actuator.actuator_model == "resonance",
    ),
    (("tracking_",), "generator = tracking", lambda d: d.actuator.generator == "tracking"),
    (
        ("thermal_resistance", "heat_capacity", "ambient_temperature"),
        "heating = true",
        lambda d: d.actuator.heating,
    ),
    (
        ("effective_tool_",),
        "contact_model = given",
        lambda d: d.parameters.contact_model == "given",
    ),
)


def doubts(given: Mapping[str, Any], settings: Settings) -> Iterator[str]:
    """Yield a line for each given value that has no effect, or is probably a mistake.

    Default values do not count, because files may list all parameters.
    """
    drill = settings.configuration
    for name, value in given.items():
        if name not in PARAMETERS or value == PARAMETERS[name].default:
            continue
        for names, need, has in _NEEDS:
            if name.startswith(names) and not has(drill):
                yield f"{name} = {value} has no effect: it needs {need}"
    free, whole = drill.parameters.free_mass, drill.parameters.rpud_mass
    if free > _MOST_FREE_MASS * whole:
        yield (
            f"free_mass = {free:g} kg is more than {_MOST_FREE_MASS:g} of rpud_mass = {whole:g} kg"
            "; the unit is kg"
        )
