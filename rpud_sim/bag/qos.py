"""Quality-of-service profiles as rosbag2 writes them. Durations are integer nanoseconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rpud_sim.bag.errors import BagFormatError, parsing
from rpud_sim.foundation.time import SECOND

INFINITE = 2**63 - 1  # unlimited duration [ns]; in YAML ``sec: 9223372036``, ``nsec: 854775807``

# rosbag2 wrote the index until version 8, and writes the word since.
_HISTORY = ("system_default", "keep_last", "keep_all", "unknown")
_RELIABILITY = ("system_default", "reliable", "best_effort", "unknown", "best_available")
_DURABILITY = ("system_default", "transient_local", "volatile", "unknown", "best_available")
_LIVELINESS = (
    "system_default",
    "automatic",
    "manual_by_node",
    "manual_by_topic",
    "unknown",
    "best_available",
)
_DURATIONS = ("deadline", "lifespan", "liveliness_lease_duration")


@dataclass(frozen=True)
class QosProfile:
    """Quality of service that one publisher offers, in rosbag2's words.

    Discovery does not carry history and depth: recorded offers have ``unknown`` and 0.
    """

    history: str = "unknown"  # policy
    depth: int = 0  # of the history
    reliability: str = "reliable"  # policy
    durability: str = "volatile"  # policy
    deadline: int = INFINITE  # [ns]
    lifespan: int = INFINITE  # [ns]
    liveliness: str = "automatic"  # policy
    liveliness_lease_duration: int = INFINITE  # [ns]
    avoid_ros_namespace_conventions: bool = False  # whether the topic's name is used as it is

    def to_mapping(self) -> dict[str, Any]:
        """Return the fields as in rosbag2's YAML."""
        return {
            name: _duration_to_mapping(value) if name in _DURATIONS else value
            for name, value in vars(self).items()
        }


def profiles_from_yaml(value: Any) -> tuple[QosProfile, ...]:
    """Return the profiles of a parsed YAML list, with policies as words or as older numbers."""
    if not value:
        return ()
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise BagFormatError(f"offered_qos_profiles is {value!r:.80}; it must be a list")
    return tuple(_profile_from_mapping(item) for item in value)


def _profile_from_mapping(item: Any) -> QosProfile:
    with parsing("a profile of offered_qos_profiles"):
        return QosProfile(
            history=_policy(item["history"], _HISTORY),
            depth=int(item["depth"]),
            reliability=_policy(item["reliability"], _RELIABILITY),
            durability=_policy(item["durability"], _DURABILITY),
            deadline=_duration_from_mapping(item["deadline"]),
            lifespan=_duration_from_mapping(item["lifespan"]),
            liveliness=_policy(item["liveliness"], _LIVELINESS),
            liveliness_lease_duration=_duration_from_mapping(item["liveliness_lease_duration"]),
            avoid_ros_namespace_conventions=bool(item["avoid_ros_namespace_conventions"]),
        )


def _policy(value: Any, words: Sequence[str]) -> str:
    if isinstance(value, int):
        return words[value] if 0 <= value < len(words) else "unknown"
    return value if value in words else "unknown"


def _duration_to_mapping(nanoseconds: int) -> dict[str, int]:
    return {"sec": nanoseconds // SECOND, "nsec": nanoseconds % SECOND}


def _duration_from_mapping(value: Mapping[str, Any]) -> int:
    # Older middlewares wrote other values for "unlimited", all of them longer than 68 years.
    nanoseconds = int(value["sec"]) * SECOND + int(value["nsec"])
    return INFINITE if nanoseconds >= 0x7FFFFFFF * SECOND else nanoseconds
