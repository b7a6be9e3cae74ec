"""Powers of a drill: from where they come, and where they go.

A source with a negative power takes it: it is on the other side.
"""

from __future__ import annotations

import math
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
# Further fields, of a drill with a feed; NaN without one, and missing in earlier messages.
FEED_POWERS = ("weight_on_bit_power", "feed_power", "mount_power")

FEED = "feed"
GRAVITY = "gravity"
MOUNT = "arm, preload of the load spring and hole"

Terms = dict[str, float]


def terms(powers: Mapping[str, float]) -> tuple[Terms, Terms]:
    """Return inflows and outflows by their names in the picture, of either sign [W].

    Powers have the names of ``INFLOWS`` and ``OUTFLOWS``, and of ``FEED_POWERS`` if there are. With
    a feed, its work flows in, in place of that of the weight on bit: the weight on bit passes it on
    to the drill.
    """
    into = {text: powers[name] for name, text in INFLOWS.items()}
    out = {text: powers[name] for name, text in OUTFLOWS.items()}
    if all(math.isfinite(powers.get(name, math.nan)) for name in FEED_POWERS):
        weight = into.pop(INFLOWS["weight_power"])
        into[FEED] = powers["feed_power"]
        into[GRAVITY] = weight - powers["weight_on_bit_power"]
        out[MOUNT] = powers["mount_power"]
    return into, out
