"""What a run was: the drill's parameters, and what recorded it where, as a record in the bag."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from rpud_sim.bag.errors import BagFormatError

RECORD_NAME = "rpud_manifest"
"""Metadata record of a manifest. A bag has one for each drill that ran while it was recorded."""

_KEY = "manifest"
_PACKAGES = ("rpud_sim", "numpy", "numba", "mcap")


@dataclass(frozen=True)
class Manifest:
    """How a run came about, as far as its recorder knows.

    `node` is the drill's full name, empty where there was none, and `parameters` are all of its
    parameters at `time` [ns since the epoch]. `scenario` is the text of its scenario (a recorder
    has the faults as they were drawn), empty where it has none, None where it is unknown.
    `command` is the command line of what wrote the bag, `versions` and `machine` (architecture and
    processor) are of the same.
    """

    node: str = ""
    time: int = 0
    parameters: Mapping[str, Any] = field(default_factory=dict)
    scenario: str | None = ""
    command: tuple[str, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    machine: str = ""

    @property
    def seed(self) -> int | None:
        """Seed of all that was drawn, None where it is unknown."""
        seed = self.parameters.get("seed")
        return int(seed) if isinstance(seed, int | float) and float(seed).is_integer() else None

    def to_record(self) -> dict[str, str]:
        """Give the content of the metadata record: one key with a JSON object."""
        content = _readable(asdict(self))
        return {_KEY: json.dumps(content, ensure_ascii=False, default=repr)}


def manifest_from_record(record: Mapping[str, str]) -> Manifest:
    """Read the content of the metadata record; what a later version adds is left out.

    Raises BagFormatError where it is not one.
    """
    try:
        value = _readable(json.loads(record[_KEY]))
        scenario = value["scenario"]
        return Manifest(
            node=str(value["node"]),
            time=int(value["time"]),
            parameters=dict(value["parameters"].items()),
            scenario=None if scenario is None else str(scenario),
            command=tuple(str(word) for word in value["command"]),
            versions={str(name): str(text) for name, text in value["versions"].items()},
            machine=str(value["machine"]),
        )
    except (
        AttributeError,
        LookupError,
        OverflowError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        raise BagFormatError(f"the record {RECORD_NAME} is unreadable: {error!r:.200}") from error


def _readable(value: Any) -> Any:
    """Give a value whose texts have an encoding: file names may be bytes that are no UTF-8."""
    if isinstance(value, str):
        try:
            return value.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
        except UnicodeEncodeError:  # half of a pair, which JSON can have
            return value.encode("utf-8", "backslashreplace").decode("utf-8")
    if isinstance(value, Mapping):
        return {_readable(key): _readable(item) for key, item in value.items()}
    return [*map(_readable, value)] if isinstance(value, list | tuple) else value


def installed_versions() -> dict[str, str]:
    """Give the versions that a run's numbers depend on; one that is not known is left out."""
    versions = {
        "python": platform.python_version(),
        "ros_distro": os.environ.get("ROS_DISTRO") or "jazzy",  # the wheels of it do not set that
    }
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return versions


def machine_name() -> str:
    """Name the architecture and the processor; no name of the host."""
    return " ".join(filter(None, (platform.machine(), _processor())))


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    fields = (line.partition(":") for line in lines)
    return next((value.strip() for key, _, value in fields if key.strip() == "model name"), "")
