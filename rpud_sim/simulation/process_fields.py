"""Fields of the messages of rotation, mount and borehole, and of their joints.

As in ``rpud_sim.simulation.fields``, they come as columns.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np

from rpud_sim.drilling.process import ProcessState
from rpud_sim.simulation.fields import Fields, Joint, header_fields

# Joints of urdf/rpud_feed.urdf.
FEED_JOINT = "rpud_feed"
ROTATION_JOINT = "rpud_rotation"

# Fields of each topic: attributes of the part of the state that has the topic's name.
_FIELDS: Mapping[str, tuple[str, ...]] = {
    "rotation": ("angle", "rate", "torque", "drive_torque", "stalled"),
    "mount": ("position", "feed", "rate", "force", "weight_on_bit", "in_contact", "slip"),
    "borehole": (
        *("depth", "penetration_rate", "layer", "specific_energy", "packed_cuttings"),
        *("bit_wear", "side_offset"),
    ),
}
PROCESS_TOPICS = tuple(_FIELDS)
_VALUES = {topic: attrgetter(*names) for topic, names in _FIELDS.items()}

States = Sequence[ProcessState]


def has_part(states: States, topic: str) -> bool:
    """Return whether states, all of one drill, have the part of a topic."""
    return bool(states) and getattr(states[0], topic) is not None


def process_fields(
    topic: str, states: States, stamps: np.ndarray
) -> Iterator[tuple[slice, Fields]]:
    """Yield columns of a topic of ``PROCESS_TOPICS``, and which of the states they are of.

    All messages of columns have the same texts, so those of each layer come by themselves.
    """
    names = _FIELDS[topic]
    rows = [_VALUES[topic](getattr(state, topic)) for state in states]
    first = 0
    for _, group in groupby(rows, key=_texts):
        columns = list(zip(*group, strict=True))
        among = slice(first, first + len(columns[0]))
        fields = {name: _column(values) for name, values in zip(names, columns, strict=True)}
        yield among, {"header": header_fields(topic, stamps[among]), **fields}
        first = among.stop


def process_joints(states: States) -> Iterator[Joint]:
    """Yield the joints of rotation and feed, with a value for each state.

    The feed's joint is its drive, as an encoder shows it: the arm may give way beyond. Its effort
    is the force of the arm on the mount [N], that of the rotation the torque of the drive on the
    rotor [N m].
    """
    if has_part(states, "rotation"):
        turns = [state.rotation for state in states if state.rotation is not None]
        yield Joint(
            ROTATION_JOINT,
            np.array([turn.angle for turn in turns]),
            np.array([turn.rate for turn in turns]),
            np.array([turn.drive_torque for turn in turns]),
        )
    if has_part(states, "mount"):
        mounts = [state.mount for state in states if state.mount is not None]
        yield Joint(
            FEED_JOINT,
            np.array([mount.feed for mount in mounts]),
            np.array([mount.rate for mount in mounts]),
            np.array([mount.force for mount in mounts]),
        )


def mount_torque(states: States) -> np.ndarray | None:
    """Torque of the drill on the mount about its z axis for each state; None without rotation.

    The drive turns the rotor, and the mount takes the same torque the other way round [N m].
    """
    if not has_part(states, "rotation"):
        return None
    turns = [state.rotation for state in states if state.rotation is not None]
    return 0.0 - np.array([turn.drive_torque for turn in turns])  # no negative zero


def _texts(row: tuple[Any, ...]) -> tuple[str, ...]:
    return tuple(value for value in row if isinstance(value, str))


def _column(values: tuple[Any, ...]) -> Any:
    return values[0] if isinstance(values[0], str) else np.array(values)
