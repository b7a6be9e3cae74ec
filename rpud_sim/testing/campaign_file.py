"""Campaign files in YAML: system under test, scenarios and all runs, checked before any starts."""

from __future__ import annotations

import dataclasses
import difflib
import importlib.util
import itertools
import os
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from rpud_sim.foundation.quantities import (
    ParameterError,
    Quantity,
    did_you_mean,
    short_repr,
)
from rpud_sim.foundation.schema import Reader, key, line, list_of, name_in, named, raw_reader, read
from rpud_sim.foundation.yaml_files import YamlNode, open_yaml
from rpud_sim.simulation.configuration import PARAMETERS
from rpud_sim.simulation.topics import COMMAND_TOPICS, TOPICS
from rpud_sim.testing.errors import subscribed
from rpud_sim.testing.setup import DrillSetup, drill_setup, find_file
from rpud_sim.verdicts import Expectation, read_expectations
from rpud_sim.verdicts.notation import parse_expectations

_LIMIT = Quantity("s", "a real time", 0.0, 1e5, exclusive=True)
_DURATION = Quantity("s", "simulation time of a run", 0.0, 1e5, exclusive=True)
_MOST_RUNS = 100_000
_ELSEWHERE = {"seed": "give seeds", "faults": "give them to a scenario"}


def _answer(cursor: YamlNode) -> str:
    name = line(cursor)
    if name in TOPICS:
        raise cursor.wrong("is a topic of the drill itself")
    commands = (each.rpartition("/")[2] for each in COMMAND_TOPICS)
    if name.startswith("command/") or difflib.get_close_matches(name, commands, cutoff=0.8):
        return name_in(COMMAND_TOPICS, "a command of the drill")(cursor)
    return name


def _pattern(cursor: YamlNode) -> str:
    try:
        re.compile(line(cursor))
    except re.error as error:
        raise cursor.wrong(f"is not a valid regular expression: {error}") from None
    return str(cursor.value)


_TOPICS_OF_DRILL = list_of(name_in(TOPICS, "a topic of the drill"), unique=True)


@dataclasses.dataclass(frozen=True)
class CampaignSystem:
    """System under test."""

    # topics on which it answers each step
    answers: tuple[str, ...] = key(list_of(_answer, 1, unique=True))
    command: str = key(line, "")  # that starts it; empty with a launch file
    launch: str = key(line, "")  # file that starts it
    arguments: Mapping[str, Any] = key(named(raw_reader), {})  # of the launch file
    folder: str = key(line, "")  # in which it starts, relative to the campaign's folder
    # topics of the drill that it subscribes to
    subscribes_to: tuple[str, ...] = key(_TOPICS_OF_DRILL, ())
    hears: tuple[str, ...] = key(_TOPICS_OF_DRILL, ())  # its name in 0.3
    ready: str = key(_pattern, "")  # that its output has when it is ready; empty for none
    # simulation time between two answers [s]
    period: float = key(Quantity("s", "", 1e-3, 1e3), 0.1)
    answer_timeout: float = key(_LIMIT, 10.0)  # longest real time for the answers to one step [s]
    start_timeout: float = key(_LIMIT, 30.0)  # longest real time until it is ready [s]
    run_timeout: float = key(_LIMIT, 600.0)  # longest real time of a whole run [s]
    campaign: Path = Path()  # folder of the campaign's file

    def __post_init__(self) -> None:
        if self.hears:
            object.__setattr__(self, "subscribes_to", subscribed(self.subscribes_to, self.hears))

    @property
    def name(self) -> str:
        """Name for messages; the command's file if empty."""
        return Path(self.launch).name

    @cached_property
    def place(self) -> Path:
        """Folder in which it starts."""
        place = (self.campaign / self.folder).resolve()
        if not os.path.isdir(place):
            raise ParameterError(f"folder = {short_repr(self.folder)} is not a folder")
        return place

    @cached_property
    def words(self) -> tuple[str, ...]:
        """Words of the command that starts it."""
        if self.launch:
            file = find_file(self.launch, "launch", (self.place,))
            if importlib.util.find_spec("launch_ros") is None:
                raise ParameterError(
                    "launch: the Python package launch_ros is missing, which comes with an "
                    "installed ROS; use command here"
                )
            given = (f"{name}:={_launch_text(value)}" for name, value in self.arguments.items())
            return sys.executable, "-m", "rpud_sim.testing.launcher", str(file), *given
        try:
            words = shlex.split(self.command)
        except ValueError as error:
            raise ParameterError(f"command = {short_repr(self.command)}: {error}") from None
        if words[0] in ("python", "python3"):
            words[0] = sys.executable
            if words[1:] and words[1].endswith(".py"):
                find_file(words[1], "command", (self.place,))
        elif "/" in words[0]:
            find_file(words[0], "command", (self.place,))
        elif shutil.which(words[0]) is None:
            raise ParameterError(f"command: no program {short_repr(words[0])} on the PATH")
        return tuple(words)


def _launch_text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _folder_of(cursor: YamlNode) -> Path:
    return Path(cursor.file).parent.absolute()


def _system(cursor: YamlNode) -> CampaignSystem:
    system: CampaignSystem = read(cursor, CampaignSystem)
    if bool(system.command) == bool(system.launch):
        raise cursor.error("system needs either command or launch")
    if system.command and system.arguments:
        raise cursor.error("arguments belong to launch; command has its arguments itself")
    system = dataclasses.replace(system, campaign=_folder_of(cursor))
    system.words  # noqa: B018, checks it
    return system


def _options(values: Reader) -> Callable[[YamlNode], dict[str, Any]]:
    """Return the reader of options of the drill by name; their values are checked together."""

    def read_options(cursor: YamlNode) -> dict[str, Any]:
        found = named(values)(cursor)
        for name, hint in _ELSEWHERE.items():
            if name in found:
                raise cursor.get(name).error(f"{name} cannot be set here: {hint}")
        return found

    return read_options


def _expectations(cursor: YamlNode) -> tuple[Expectation, ...]:
    if not isinstance(cursor.value, str):
        return parse_expectations(cursor)
    return read_expectations(find_file(cursor.value, "expectations", (_folder_of(cursor),)))


@dataclasses.dataclass(frozen=True)
class _Scenario:
    faults: Any = key(raw_reader, None)
    duration: float | None = key(_DURATION, None)
    parameters: Mapping[str, Any] = key(_options(raw_reader), {})


def _scenario(cursor: YamlNode) -> _Scenario:
    found: _Scenario = read(dataclasses.replace(cursor, value=cursor.value or {}), _Scenario)
    return found


@dataclasses.dataclass(frozen=True)
class _CampaignFile:
    system: CampaignSystem = key(_system)
    duration: float = key(_DURATION)
    scenarios: Mapping[str, _Scenario] = key(named(_scenario))
    expectations: tuple[Expectation, ...] = key(_expectations)
    name: str = key(line, "")
    requirements: Mapping[str, str] = key(named(line), {})
    drill: Mapping[str, Any] = key(_options(raw_reader), {})
    parameters: Mapping[str, tuple[Any, ...]] = key(
        _options(list_of(raw_reader, 1, unique=True)), {}
    )
    seeds: tuple[int, ...] = key(list_of(PARAMETERS["seed"].allowed, 1, unique=True), (0,))


class CampaignRun(NamedTuple):
    """One run of a campaign."""

    scenario: str
    faults: tuple[str, ...]  # phrase for each fault
    duration: float  # of simulation time [s]
    parameters: Mapping[str, Any]  # values of the parameters that the campaign varies
    setup: DrillSetup  # of the drill

    @property
    def name(self) -> str:
        """Name of the run, which is unique in its campaign."""
        values = [f"{name}={value}" for name, value in self.parameters.items()]
        return " ".join([self.scenario, *values, f"seed={self.setup.seed}"])


class Campaign(NamedTuple):
    """Campaign, checked as a whole."""

    name: str
    requirements: Mapping[str, str]  # text of each requirement by its identifier; may be empty
    system: CampaignSystem
    runs: tuple[CampaignRun, ...]  # all of them, in order
    expectations: tuple[Expectation, ...]  # on each run


def read_campaign(path: str | Path) -> Campaign:
    """Return the campaign of a file; relative paths in it begin at its folder."""
    top = open_yaml(path)
    file: _CampaignFile = read(top, _CampaignFile)
    listed = top.get("expectations")
    for index, each in enumerate(file.expectations):
        if file.requirements and each.requirement not in file.requirements:
            place = (*listed.place, index, "requirement")
            hint = did_you_mean(each.requirement, file.requirements)
            raise dataclasses.replace(listed, place=place).error(
                f"requirement {short_repr(each.requirement)} of {short_repr(each.name)} is "
                f"unknown{hint}"
            )
    runs = tuple(_runs(top, file))
    return Campaign(
        file.name or Path(path).stem, file.requirements, file.system, runs, file.expectations
    )


def _runs(top: YamlNode, file: _CampaignFile) -> list[CampaignRun]:
    varied = file.parameters
    _setup(file.drill, top.get("drill"))
    for name, values in varied.items():
        for value in values:
            _setup({**file.drill, name: value}, top.get("parameters"))
    points = [dict(zip(varied, each, strict=True)) for each in itertools.product(*varied.values())]
    count = len(file.scenarios) * len(points) * len(file.seeds)
    if not 0 < count <= _MOST_RUNS:
        raise top.get("scenarios").error(f"{count} runs: there may be 1 to {_MOST_RUNS}")
    runs = []
    for name, each in file.scenarios.items():
        cursor = top.get("scenarios").get(name)
        for twice in each.parameters.keys() & varied.keys():
            raise cursor.error(f"scenario {name}: {twice} is varied by the campaign")
        faults = {} if each.faults is None else {"faults": each.faults}
        for point, seed in itertools.product(points, file.seeds):
            options = {**file.drill, **each.parameters, **faults, **point, "seed": seed}
            setup = _setup(options, cursor)
            phrases = tuple(dict.fromkeys(map(str, setup.faults)))
            runs.append(CampaignRun(name, phrases, each.duration or file.duration, point, setup))
    return runs


def _setup(options: Mapping[str, Any], cursor: YamlNode) -> DrillSetup:
    """Return the drill of options; an error has the line of the option that it names."""
    with cursor.errors():
        return drill_setup(options, (_folder_of(cursor),), cursor)
