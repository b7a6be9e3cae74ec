"""Powers of a drill: from where they come, and where they go.

A source with a negative power takes it: it is on the other side.
"""

from __future__ import annotations

from collections.abc import Mapping

# Fields of ``rpud_msgs/Status``, and their names in the picture.
INFLOWS = {
    "actuator_power": "work of the vibration",
    "weight_power": "weight on bit and gravity",
    "change_power": "changed parameters",
}
OUTFLOWS = {
    "absorbed_power": "drill tool and rock",
    "collision_power": "collisions of actuator and free mass",
    "load_damper_power": "damping of the load spring",
    "stored_power": "stored in motion and springs",
}


def flows(powers: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Return inflows and outflows by their names in the picture, all positive [W].

    Args:
        powers: by the names of ``INFLOWS`` and ``OUTFLOWS``.
    """
    signed = [(text, powers[name]) for name, text in INFLOWS.items()]
    signed += [(text, -powers[name]) for name, text in OUTFLOWS.items()]
    into = {text: power for text, power in signed if power > 0.0}
    out = {text: -power for text, power in signed if power < 0.0}
    return into, out
