"""QoS overrides: a file in rosbag2's format, in place of what publishers offer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.qos import RECORDING_DEPTH

_SIZE_LIMIT = 1_000_000  # bytes
# PyYAML raises these for a text that does not fit its tag, such as ``!!timestamp 1``.
_YAML_ERRORS = (AttributeError, LookupError, RecursionError, TypeError, ValueError)
_DURATION_LIMIT = 2**31 - 1  # s


class QosOverrideError(ValueError):
    """Invalid file of overrides; the text names the file, the topic and the policy."""


@dataclass(frozen=True)
class _Policy:
    kind: type

    def __call__(self, value: Any) -> Any:
        word = value if isinstance(value, str) else ""
        allowed = [key for key in self.kind.short_keys() if key != "unknown"]  # type: ignore[attr-defined]
        if word not in allowed:
            raise ValueError(f"{value!r:.80}; it must be one of {', '.join(allowed)}")
        return self.kind.get_from_short_key(word)  # type: ignore[attr-defined]


def _depth(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**31:
        raise ValueError(f"{value!r:.80}; it must be a whole number from 0 to {2**31 - 1}")
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{value!r:.80}; it must be true or false")
    return value


def _duration(value: Any) -> Duration:
    parts = value if isinstance(value, Mapping) else {}
    seconds, nanoseconds = parts.get("sec"), parts.get("nsec")
    for part, most in ((seconds, _DURATION_LIMIT), (nanoseconds, SECOND - 1)):
        if not isinstance(part, int) or isinstance(part, bool) or not 0 <= part <= most:
            raise ValueError(
                f"{value!r:.80}; it must be sec from 0 to {_DURATION_LIMIT} "
                "and nsec from 0 to 999999999"
            )
    return Duration(seconds=int(seconds), nanoseconds=int(nanoseconds))  # type: ignore[arg-type]


_READERS: Mapping[str, Callable[[Any], Any]] = {
    "history": _Policy(HistoryPolicy),
    "depth": _depth,
    "reliability": _Policy(ReliabilityPolicy),
    "durability": _Policy(DurabilityPolicy),
    "deadline": _duration,
    "lifespan": _duration,
    "liveliness": _Policy(LivelinessPolicy),
    "liveliness_lease_duration": _duration,
    "avoid_ros_namespace_conventions": _flag,
}


def read_qos_overrides(path: str) -> dict[str, QoSProfile]:
    """Read the profile of each topic in a YAML file.

    A missing policy is the middleware's default, a missing depth ``RECORDING_DEPTH``.

    Raises:
        QosOverrideError: if the file cannot be used.
    """
    try:
        if Path(path).stat().st_size > _SIZE_LIMIT:
            raise QosOverrideError(f"{path} has more than {_SIZE_LIMIT} bytes")
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise QosOverrideError(f"cannot read {path}: {error.strerror}") from error
    except QosOverrideError:
        raise
    except (yaml.YAMLError, *_YAML_ERRORS) as error:
        raise QosOverrideError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if content is None:
        return {}
    if not isinstance(content, Mapping):
        raise QosOverrideError(f"{path} must name topics, each with its policies")
    return {str(topic): _profile(path, str(topic), value) for topic, value in content.items()}


def _profile(path: str, topic: str, value: Any) -> QoSProfile:
    if not isinstance(value, Mapping):
        raise QosOverrideError(f"{path}: {topic} must have policies")
    if not topic.startswith("/"):
        raise QosOverrideError(f"{path}: {topic} must be an absolute name, such as /{topic}")
    policies: dict[str, Any] = {"depth": RECORDING_DEPTH}
    for key, item in value.items():
        reader = _READERS.get(key) if isinstance(key, str) else None
        if reader is None:
            raise QosOverrideError(
                f"{path}: {topic} has {key!r:.80}; policies are {', '.join(_READERS)}"
            )
        try:
            policies[key] = reader(item)
        except ValueError as error:
            raise QosOverrideError(f"{path}: {topic}: {key} is {error}") from error
    return QoSProfile(**policies)
