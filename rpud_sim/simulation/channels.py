"""Channels on which a signal fault may act: topics that a real drill would measure."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

Path = tuple[str, ...]

# Tests compare with these, the ground truth: no signal fault may change them.
GROUND_TRUTH = ("waveform", "trajectory", "borehole")


@dataclasses.dataclass(frozen=True)
class Channel:
    """Measured fields of a topic, by their paths in the message.

    Stamps, frames and sequence numbers are no measurements: no fault changes them.
    """

    unit: str  # SI unit of the main quantity, on which noise and bias act
    scale: float  # a disturbance of the main quantity that mission software notices, assumed [unit]
    numbers: tuple[Path, ...]  # every measured number; the first is the main quantity
    flags: tuple[Path, ...] = ()  # every measured truth value


CHANNELS: Mapping[str, Channel] = {
    "nodal_plane": Channel("m", 1e-4, (("position",), ("velocity",))),
    "drill_tool": Channel("m", 1e-5, (("displacement",), ("velocity",)), (("in_contact",),)),
    "reacting_force": Channel("N", 1.0, (("force",),)),
    "wrench": Channel(
        "N",
        1.0,
        (
            ("wrench", "force", "z"),
            ("wrench", "force", "x"),
            ("wrench", "force", "y"),
            ("wrench", "torque", "x"),
            ("wrench", "torque", "y"),
            ("wrench", "torque", "z"),
        ),
    ),
    "contact_force": Channel(
        "N",
        1e3,
        (
            ("peak_force",),
            ("contact_duration",),
            ("impact_velocity",),
            ("impulse",),
            ("energy",),
            ("energy_transferred",),
        ),
        (("squeezed",),),
    ),
    "rotation": Channel(
        "N m",
        1e-2,
        (("torque",), ("drive_torque",), ("angle",), ("rate",)),
        (("stalled",),),
    ),
    "mount": Channel(
        "N",
        1.0,
        (("force",), ("weight_on_bit",), ("position",), ("feed",), ("rate",), ("slip",)),
        (("in_contact",),),
    ),
}
