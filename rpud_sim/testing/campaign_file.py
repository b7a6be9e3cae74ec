"""Campaign files in YAML: system under test, scenarios and all runs, checked before any starts."""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
import re
import shlex
import shutil
import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from rpud_sim.foundation.quantities import (
    Flag,
    ParameterError,
    Quantity,
    did_you_mean,
    shown,
    suggestion,
)
from rpud_sim.foundation.yaml_files import Cursor, open_yaml
from rpud_sim.simulation.configuration import PARAMETERS
from rpud_sim.simulation.topics import COMMAND_TOPICS, TOPICS
from rpud_sim.testing.setup import DrillSetup, drill_setup, find_file
from rpud_sim.verdicts import Expectation, read_expectations
from rpud_sim.verdicts.notation import parse_expectations

_KEYS = (
    *("name", "requirements", "system", "drill", "duration", "scenarios", "parameters"),
    *("seeds", "expectations"),
)
_LIMIT = Quantity("s", "a real time", 0.0, 1e5, exclusive=True)
_TIMES = {  # of the system: range and default
    "period": (Quantity("s", "simulation time between two answers", 1e-3, 1e3), 0.1),
    "answer_timeout": (_LIMIT, 10.0),
    "start_timeout": (_LIMIT, 30.0),
    "run_timeout": (_LIMIT, 600.0),
}
_SYSTEM_KEYS = ("command", "launch", "arguments", "folder", "answers", "hears", "ready", *_TIMES)
_DURATION = Quantity("s", "simulation time of a run", 0.0, 1e5, exclusive=True)
_MOST_RUNS = 100_000
_ELSEWHERE = {"seed": "give seeds", "faults": "give them to a scenario"}


class CampaignSystem(NamedTuple):
    """System under test."""

    command: tuple[str, ...]  # words
    name: str  # for messages; the command's file if empty
    folder: Path  # in which it starts
    answers: tuple[str, ...]  # topics on which it answers each step
    hears: tuple[str, ...]  # topics of the drill that it subscribes to
    ready: str  # regular expression that its output has when it is ready; empty for none
    period: float  # simulation time between two answers [s]
    answer_timeout: float  # longest real time for the answers to one step [s]
    start_timeout: float  # longest real time until it is ready [s]
    run_timeout: float  # longest real time of a whole run [s]


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
    # Without truth values: off is a kind of fault.
    top = open_yaml(path, truth_values=False)
    top = dataclasses.replace(top, name="the file")
    _entries(top, _KEYS, ("system", "duration", "scenarios", "expectations"))
    folder = Path(path).parent.absolute()
    requirements = {
        str(key): _line(each) for key, each in _entries(top.get("requirements", {})).items()
    }
    return Campaign(
        _line(top.get("name", Path(path).stem)),
        requirements,
        _system(top.get("system"), folder),
        _runs(top, folder),
        _expectations(top.get("expectations"), folder, requirements),
    )


def _entries(
    cursor: Cursor, known: tuple[str, ...] | None = None, needed: tuple[str, ...] = ()
) -> dict[Any, Cursor]:
    other, unknown = "{name} = {shown} is no mapping", "{shown}: {hint}"
    return cursor.mapping(known, needed, other=other, unknown=unknown)


def _list(cursor: Cursor) -> list[Cursor]:
    """Return the entries of a list, which is not empty and has none twice."""
    if not (isinstance(cursor.value, list) and cursor.value):
        raise cursor.refusal("{name} = {shown} is no list of values")
    if len({repr(each) for each in cursor.value}) < len(cursor.value):
        raise cursor.refusal("{name} = {shown} has a value twice")
    return [dataclasses.replace(each, name=cursor.name) for each in cursor.sequence()]


def _line(cursor: Cursor) -> str:
    if not (isinstance(cursor.value, str) and cursor.value.strip() and cursor.value.isprintable()):
        raise cursor.refusal("{name} = {shown} is not a text of one line")
    return cursor.value


def _known(cursor: Cursor, known: Collection[str]) -> str:
    if _line(cursor) not in known:
        raise cursor.refusal("{name}: the drill has no topic {shown}; {hint}", known)
    return str(cursor.value)


def _system(cursor: Cursor, folder: Path) -> CampaignSystem:
    entries = _entries(cursor, _SYSTEM_KEYS, ("answers",))
    if "folder" in entries:
        folder = (folder / _line(entries["folder"])).resolve()
        if not folder.is_dir():
            raise entries["folder"].refusal("folder = {shown} is no folder")
    hears, launch = cursor.get("hears", []), entries.get("launch")
    ready = _line(entries["ready"]) if entries.get("ready") else ""
    with cursor.get("ready").errors():
        try:
            re.compile(ready)
        except re.error as error:
            raise ParameterError(f"ready = {shown(ready)}: {error}") from None
    return CampaignSystem(
        _command(cursor, entries, folder),
        Path(launch.value).name if launch else "",
        folder,
        tuple(map(_answer, _list(entries["answers"]))),
        tuple(_known(each, TOPICS) for each in (_list(hears) if hears.value else ())),
        ready,
        *(cursor.get(name, default).check(range) for name, (range, default) in _TIMES.items()),
    )


def _command(system: Cursor, entries: Mapping[str, Cursor], folder: Path) -> tuple[str, ...]:
    if ("command" in entries) == ("launch" in entries):
        raise system.refusal("system needs either command or launch")
    if launch := entries.get("launch"):
        with launch.errors():
            file = find_file(launch.value, "launch", (folder,))
            if importlib.util.find_spec("launch_ros") is None:
                raise ParameterError(
                    "launch: the Python package launch_ros is missing, which comes with an "
                    "installed ROS; use command here"
                )
        given = [
            f"{name}:={each.value}" for name, each in _entries(system.get("arguments", {})).items()
        ]
        return sys.executable, "-m", "rpud_sim.testing.launcher", str(file), *given
    command = entries["command"]
    with command.errors():
        try:
            words = shlex.split(_line(command))
        except ValueError as error:
            raise ParameterError(f"command = {shown(command.value)}: {error}") from None
        if "arguments" in entries or not words:
            raise ParameterError("command has its arguments itself")
        if words[0] in ("python", "python3"):
            words[0] = sys.executable
            if words[1:] and words[1].endswith(".py"):
                find_file(words[1], "command", (folder,))
        elif "/" in words[0]:
            find_file(words[0], "command", (folder,))
        elif shutil.which(words[0]) is None:
            raise ParameterError(f"command: no program {shown(words[0])} on the PATH")
    return tuple(words)


def _answer(cursor: Cursor) -> str:
    name = _line(cursor)
    if name in TOPICS:
        raise cursor.refusal("answers: {shown} is a topic of the drill itself")
    if suggestion(name, COMMAND_TOPICS) or name.startswith("command/"):
        return _known(cursor, COMMAND_TOPICS)
    return name


def _expectations(
    cursor: Cursor, folder: Path, requirements: Mapping[str, str]
) -> tuple[Expectation, ...]:
    if isinstance(cursor.value, str):
        with cursor.errors():
            file = find_file(cursor.value, "expectations", (folder,))
        found = read_expectations(file)
    else:
        found = parse_expectations(cursor)
    for index, each in enumerate(found):
        if requirements and each.requirement not in requirements:
            place = (*cursor.place, index, "requirement")
            hint = did_you_mean(each.requirement, requirements)
            with dataclasses.replace(cursor, place=place).errors():
                raise ParameterError(f"requirement of {shown(each.name)}: {hint}")
    return found


def _runs(top: Cursor, folder: Path) -> tuple[CampaignRun, ...]:
    drill, varied = _options(top.get("drill", {})), _options(top.get("parameters", {}), lists=True)
    _setup(drill, folder, top.get("drill"))
    for name, values in varied.items():
        for value in values:
            _setup({**drill, name: value}, folder, top.get("parameters"))
    seeds = [
        dataclasses.replace(each, name="seed").check(PARAMETERS["seed"].allowed)
        for each in _list(top.get("seeds", [0]))
    ]
    points = [dict(zip(varied, each, strict=True)) for each in itertools.product(*varied.values())]
    scenarios = _entries(top.get("scenarios"))
    count = len(scenarios) * len(points) * len(seeds)
    if not 0 < count <= _MOST_RUNS:
        raise top.get("scenarios").refusal(f"{count} runs: there may be 1 to {_MOST_RUNS}")
    duration, runs = top.get("duration").check(_DURATION), []
    for name, each in scenarios.items():
        label = _line(dataclasses.replace(each, name="scenario", value=str(name)))
        cursor = dataclasses.replace(each, name=f"scenario {label}", value=each.value or {})
        entries = _entries(cursor, ("faults", "duration", "parameters"))
        own = _options(cursor.get("parameters", {}))
        for twice in own.keys() & varied.keys():
            raise cursor.refusal(f"{{name}}: {twice} is varied by the campaign")
        faults = {"faults": entries["faults"].value} if "faults" in entries else {}
        length = float(cursor.get("duration", duration).check(_DURATION))
        for point, seed in itertools.product(points, seeds):
            setup = _setup({**drill, **own, **faults, **point, "seed": seed}, folder, cursor)
            runs.append(CampaignRun(label, _phrases(setup.scenario), length, point, setup))
    return tuple(runs)


def _options(cursor: Cursor, lists: bool = False) -> dict[str, Any]:
    """Return options of the drill by name, or with ``lists`` the values of each."""
    found = {}
    for name, each in _entries(cursor).items():
        if name in _ELSEWHERE:
            raise each.refusal(f"{{name}} cannot be set here: {_ELSEWHERE[name]}")
        values = [entry.value for entry in _list(each)] if lists else [each.value]
        # The file is read without truth values.
        if name in PARAMETERS and isinstance(PARAMETERS[name].allowed, Flag):
            values = [{"true": True, "false": False}.get(str(one), one) for one in values]
        found[str(name)] = values if lists else values[0]
    return found


def _setup(options: Mapping[str, Any], folder: Path, cursor: Cursor) -> DrillSetup:
    """Return the drill of options; an error has the line of the option that it names."""
    try:
        return drill_setup(options, (folder,))
    except ParameterError as error:
        entry = re.search(r"faults: entry (\d+):", str(error))
        place = ("faults", int(entry[1]) - 1) if entry else re.findall(r"\w+", str(error))[:1]
        with dataclasses.replace(cursor, place=(*cursor.place, *place)).errors():
            raise ParameterError(error) from None


def _phrases(scenario: str) -> tuple[str, ...]:
    faults = yaml.safe_load(scenario)["faults"]
    names = (" on ".join(filter(None, (each["kind"], each.get("channel")))) for each in faults)
    return tuple(dict.fromkeys(names))
