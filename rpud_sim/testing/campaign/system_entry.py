"""The entry ``system`` of a campaign file: the command that is tested, and how it answers."""

from __future__ import annotations

import importlib.util
import re
import shlex
import shutil
import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import Quantity, did_you_mean, shown, suggestion
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.testing.campaign.entries import (
    Place,
    check_keys,
    find_file,
    mapping,
    number,
    one_line,
    texts,
)
from rpud_sim.testing.campaign.specification import CampaignError, CampaignSystem
from rpud_sim.verdicts.names import COMMANDS

_KEYS = (
    "command",
    "launch",
    "arguments",
    "folder",
    "answers",
    "hears",
    "ready",
    "period",
    "answer_timeout",
    "start_timeout",
    "run_timeout",
)
_PLACE: Place = ("system",)
_PERIOD = Quantity("s", "simulation time between two answers", 1e-3, 1e3)
_LIMIT = Quantity("s", "a real time", 0.0, 1e5, exclusive=True)
_DEFAULTS: Mapping[str, tuple[Quantity, float]] = {
    "period": (_PERIOD, 0.1),
    "answer_timeout": (_LIMIT, 10.0),
    "start_timeout": (_LIMIT, 30.0),
    "run_timeout": (_LIMIT, 600.0),
}
_INTERPRETERS = ("python", "python3")
_LAUNCHER = "rpud_sim.testing.campaign.launcher"


def to_system(content: Any, folder: Path) -> CampaignSystem:
    """Return the system under test."""
    entries = mapping("system", content, _PLACE)
    check_keys(entries, _KEYS, _PLACE, ("answers",))
    place = folder
    if "folder" in entries:
        place = (folder / one_line("folder", entries["folder"], (*_PLACE, "folder"))).resolve()
        if not place.is_dir():
            raise CampaignError(f"folder = {place} is no folder", (*_PLACE, "folder"))
    numbers = {
        name: number(name, entries.get(name, default), quantity, (*_PLACE, name))
        for name, (quantity, default) in _DEFAULTS.items()
    }
    return CampaignSystem(
        tuple(_command(entries, place)),
        place,
        _answers(entries["answers"]),
        _hears(entries.get("hears", [])),
        _ready(entries.get("ready", "")),
        **numbers,
        name=Path(entries["launch"]).name if "launch" in entries else "",
    )


def _command(entries: Mapping[Any, Any], folder: Path) -> list[str]:
    if ("command" in entries) == ("launch" in entries):
        raise CampaignError("system needs either command or launch", _PLACE)
    if "launch" in entries:
        return _launch(entries, folder)
    if "arguments" in entries:
        raise CampaignError(
            "arguments are those of a launch file: write them into command", (*_PLACE, "arguments")
        )
    place = (*_PLACE, "command")
    text = one_line("command", entries["command"], place)
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise CampaignError(f"command = {shown(text)}: {error}", place) from None
    if not words:
        raise CampaignError("command is empty", place)
    if words[0] in _INTERPRETERS:
        words[0] = sys.executable
    elif "/" in words[0]:
        find_file(words[0], folder, "command", place)
    elif shutil.which(words[0]) is None:
        raise CampaignError(f"command: no program {shown(words[0])} on the PATH", place)
    if words[0] == sys.executable and len(words) > 1 and words[1].endswith(".py"):
        find_file(words[1], folder, "command", place)
    return words


def _launch(entries: Mapping[Any, Any], folder: Path) -> list[str]:
    place = (*_PLACE, "launch")
    file = find_file(entries["launch"], folder, "launch", place)
    if importlib.util.find_spec("launch_ros") is None:
        raise CampaignError(
            "launch: the Python package launch_ros is missing, which comes with an installed ROS; "
            "use command here",
            place,
        )
    inner = (*_PLACE, "arguments")
    arguments = mapping("arguments", entries.get("arguments", {}), inner)
    words = [f"{name}:={value}" for name, value in arguments.items()]
    return [sys.executable, "-m", _LAUNCHER, str(file), *words]


def _answers(content: Any) -> tuple[str, ...]:
    place = (*_PLACE, "answers")
    found = texts("answers", content, place)
    if not found:
        raise CampaignError("answers names no topic: a step would not wait for the system", place)
    for index, name in enumerate(found):
        if name in TOPICS:
            raise CampaignError(f"answers: {name} is a topic of the drill itself", (*place, index))
        if suggestion(name, COMMANDS) or name.startswith("command/"):
            _check_known("answers", name, COMMANDS, index)
    return found


def _hears(content: Any) -> tuple[str, ...]:
    found = texts("hears", content, (*_PLACE, "hears"))
    for index, name in enumerate(found):
        _check_known("hears", name, TOPICS, index)
    return found


def _check_known(entry: str, name: str, known: Collection[str], index: int) -> None:
    if name not in known:
        raise CampaignError(
            f"{entry}: the drill has no topic {shown(name)}; {did_you_mean(name, known)}",
            (*_PLACE, entry, index),
        )


def _ready(content: Any) -> str:
    place = (*_PLACE, "ready")
    if content == "":
        return ""
    text = one_line("ready", content, place)
    try:
        re.compile(text)
    except re.error as error:
        raise CampaignError(
            f"ready = {shown(text)} is no regular expression: {error}", place
        ) from None
    return text
