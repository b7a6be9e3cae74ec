"""Metadata records of this package: where a run comes from, and the verdict of a test about it."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from rpud_sim.foundation.json_text import finite_values, json_text, name_of
from rpud_sim.messages.errors import parsing

# Metadata record of a manifest; a bag has one for each drill that ran during the recording.
MANIFEST_RECORD = "rpud_manifest"
VERDICT_RECORD = "rpud_test"  # metadata record of a test's verdict
_PACKAGES = ("rpud_sim", "numpy", "numba", "mcap")


@dataclass(frozen=True)
class Manifest:
    """Origin of a run, as far as its recorder knows it."""

    node: str = ""  # full name of the drill; empty without one
    time: int = 0  # time of the parameters [ns since the epoch]
    parameters: Mapping[str, Any] = field(default_factory=dict)  # all parameters of the drill
    # text of the drill's scenario; empty without one, None if unknown, as for a recorder: the
    # journal contains the faults as they were drawn
    scenario: str | None = ""
    command: tuple[str, ...] = ()  # command line of the program that wrote the bag
    versions: Mapping[str, str] = field(default_factory=dict)  # versions of that program's software
    machine: str = ""  # architecture and processor of its computer
    # origin of a fork: ``bag`` and ``run`` in it, the instant ``at`` [s], the ``journal``'s
    # SHA-256 up to there, and the ``changes``
    forked_from: Mapping[str, Any] = field(default_factory=dict)

    @property
    def seed(self) -> int | None:
        """Seed of all random numbers; None if it is unknown."""
        seed = self.parameters.get("seed")
        return int(seed) if isinstance(seed, int | float) and float(seed).is_integer() else None

    def to_record(self) -> dict[str, str]:
        """Return the content of the metadata record: one key with a JSON object."""
        content = finite_values(_readable(asdict(self)), name_of)
        if not self.forked_from:
            del content["forked_from"]
        return {"manifest": json_text(content, ensure_ascii=False, default=repr)}


def manifest_from_record(record: Mapping[str, str]) -> Manifest:
    """Return the manifest from the content of the metadata record; unknown fields are ignored."""
    with parsing(f"the record {MANIFEST_RECORD}"):
        value = _readable(json.loads(record["manifest"]))
        scenario = value["scenario"]
        return Manifest(
            node=str(value["node"]),
            time=int(value["time"]),
            parameters=dict(value["parameters"].items()),
            scenario=None if scenario is None else str(scenario),
            command=tuple(str(word) for word in value["command"]),
            versions={str(name): str(text) for name, text in value["versions"].items()},
            machine=str(value["machine"]),
            forked_from=dict(value.get("forked_from", {}).items()),
        )


def _readable(value: Any) -> Any:
    """Return a value with texts that can be encoded: file names may be bytes that are not UTF-8."""
    if isinstance(value, str):
        try:
            return value.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
        except UnicodeEncodeError:  # half of a surrogate pair, which JSON may contain
            return value.encode("utf-8", "backslashreplace").decode("utf-8")
    if isinstance(value, Mapping):
        return {_readable(key): _readable(item) for key, item in value.items()}
    return [*map(_readable, value)] if isinstance(value, list | tuple) else value


def installed_versions() -> dict[str, str]:
    """Return the known versions of the software that a run's numbers depend on."""
    versions = {
        "python": platform.python_version(),
        "ros_distro": os.environ.get("ROS_DISTRO") or "jazzy",  # ROS from PyPI does not set it
    }
    for package in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[package] = metadata.version(package)
    return versions


def machine_name() -> str:
    """Return the architecture and the processor, without the name of the host."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        fields = (line.partition(":") for line in lines)
        names = [value.strip() for key, _, value in fields if key.strip() == "model name"][:1]
    except OSError:
        names = [platform.processor()]
    return " ".join(filter(None, (platform.machine(), *names)))


@dataclass(frozen=True)
class RunVerdict:
    """Verdict of a test about the run in a bag."""

    test: str  # its name
    verdict: str  # ``passed``, ``failed`` or ``undecided``
    seed: str  # seed of all random numbers
    requirements: tuple[str, ...] = ()  # each with its verdict, value and time, in one line
    failed_at: tuple[float, ...] = ()  # simulation times of failures [s]

    def to_record(self) -> dict[str, str]:
        """Return the content of the metadata record: one key with a JSON object."""
        return {"test": json_text(asdict(self))}


def tested_from_record(record: Mapping[str, str]) -> RunVerdict:
    """Return the verdict from the content of the metadata record."""
    with parsing(f"the record {VERDICT_RECORD}"):
        value = json.loads(record["test"])
        lines = tuple(str(line) for line in value["requirements"])
        times = tuple(float(time) for time in value.get("failed_at", ()))
        test, verdict, seed = (str(value[name]) for name in ("test", "verdict", "seed"))
        return RunVerdict(test, verdict, seed, lines, times)
