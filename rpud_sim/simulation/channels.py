"""The channels on which a signal fault may act: the topics that a sensor of a real drill gives."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

Path = tuple[str, ...]

# These are the ground truth that a test compares with: no fault may touch them.
GROUND_TRUTH = ("waveform", "trajectory")


@dataclasses.dataclass(frozen=True)
class Channel:
    """What a topic measures, by the names of its message's fields.

    Stamps, frames and sequence numbers are no measurements: no fault changes them.

    Args:
        unit: SI unit of the main quantity, on which noise and bias act.
        scale: a disturbance of the main quantity that mission software notices, assumed [unit].
        numbers: every measured number; the first is the main quantity.
        flags: every measured truth value.
    """

    unit: str
    scale: float
    numbers: tuple[Path, ...]
    flags: tuple[Path, ...] = ()


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
        ),
    ),
}
