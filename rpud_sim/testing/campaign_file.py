"""Campaign files in YAML: system under test, scenarios and all runs, checked before any starts."""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
import re
import shlex
import shutil
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

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
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.testing.setup import DrillSetup, drill_setup
from rpud_sim.verdicts import Expectation, ExpectationError, read_expectations
from rpud_sim.verdicts.names import COMMANDS
from rpud_sim.verdicts.notation import parse_expectations

_KEYS = (
    *("name", "requirements", "system", "drill", "duration", "scenarios", "parameters"),
    *("seeds", "expectations"),
)
_NEEDED = ("system", "duration", "scenarios", "expectations")
_SCENARIO_KEYS = ("faults", "duration", "parameters")
_SYSTEM_KEYS = (
    *("command", "launch", "arguments", "folder", "answers", "hears", "ready", "period"),
    *("answer_timeout", "start_timeout", "run_timeout"),
)
_TIME = Quantity("s", "simulation time of a run", 0.0, 1e5, exclusive=True)
_PERIOD = Quantity("s", "simulation time between two answers", 1e-3, 1e3)
_LIMIT = Quantity("s", "a real time", 0.0, 1e5, exclusive=True)
_MOST_RUNS = 100_000
_LAUNCHER = "rpud_sim.testing.launcher"


@dataclasses.dataclass(frozen=True)
class CampaignSystem:
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

    @property
    def command_line(self) -> str:
        """The command for people."""
        return shlex.join("python" if word == sys.executable else word for word in self.command)


@dataclasses.dataclass(frozen=True)
class CampaignScenario:
    """Faults of some runs, and their duration."""

    name: str
    faults: tuple[str, ...]  # phrase for each fault
    duration: float  # of simulation time [s]


@dataclasses.dataclass(frozen=True)
class CampaignRun:
    """One run of a campaign."""

    scenario: CampaignScenario
    parameters: Mapping[str, Any]  # values of the parameters that the campaign varies
    setup: DrillSetup  # of the drill

    @property
    def name(self) -> str:
        """Name of the run, which is unique in its campaign."""
        values = [f"{name}={value}" for name, value in self.parameters.items()]
        return " ".join([self.scenario.name, *values, f"seed={self.setup.seed}"])


@dataclasses.dataclass(frozen=True)
class Campaign:
    """Campaign, checked as a whole."""

    name: str
    requirements: Mapping[str, str]  # text of each requirement by its identifier; may be empty
    system: CampaignSystem
    runs: tuple[CampaignRun, ...]  # all of them, in order
    expectations: tuple[Expectation, ...]  # on each run


def read_campaign(path: str | Path) -> Campaign:
    """Return the campaign of a file; relative paths in it begin at its folder."""
    # Without truth values: off is a kind of fault.
    top = open_yaml(path, truth_values=False, where="{file}:{line}: ")
    file = Path(path)
    entries = _mapping(dataclasses.replace(top, name="the file"), _KEYS, _NEEDED)
    folder = file.parent.absolute()
    requirements = {
        str(key): _line(each) for key, each in _mapping(top.get("requirements", {})).items()
    }
    expectations = _expectations(entries["expectations"], folder, requirements)
    name = _line(top.get("name", file.stem))
    system = _system(entries["system"], folder)
    return Campaign(name, requirements, system, _runs(entries, top, folder), expectations)


def _mapping(
    cursor: Cursor, known: Iterable[str] | None = None, needed: Iterable[str] = ()
) -> dict[Any, Cursor]:
    other, unknown = "{name} = {shown} is no mapping", "{shown}: {hint}"
    return cursor.mapping(known, needed, other=other, unknown=unknown)


def _line(cursor: Cursor) -> str:
    """Return a text of one line."""
    if not (isinstance(cursor.value, str) and cursor.value.strip() and cursor.value.isprintable()):
        raise cursor.refusal("{name} = {shown} is not a text of one line")
    return cursor.value


def _file(cursor: Cursor, folder: Path, given: str = "") -> Path:
    """Return the path of a file, which is given relative to a folder."""
    given = given or _line(cursor)
    path = folder / given
    if path.is_file():
        return path.resolve()
    beside = []
    if path.parent.is_dir():
        beside = sorted(other.name for other in path.parent.iterdir() if other.is_file())
    hint = suggestion(path.name, beside)
    raise _error(cursor, f"{cursor.name} = {shown(given)} is no file in {folder}{hint}")


def _error(cursor: Cursor, reason: object) -> ParameterError:
    return ParameterError(f"{cursor.prefix}{reason}")


# The system under test.


def _system(cursor: Cursor, folder: Path) -> CampaignSystem:
    entries = _mapping(cursor, _SYSTEM_KEYS, ("answers",))
    if "folder" in entries:
        folder = (folder / _line(entries["folder"])).resolve()
        if not folder.is_dir():
            raise _error(entries["folder"], f"folder = {folder} is no folder")
    launch = entries.get("launch")
    return CampaignSystem(
        tuple(_command(cursor, entries, folder)),
        Path(launch.value).name if launch else "",
        folder,
        _answers(entries["answers"]),
        tuple(_known(each, TOPICS) for each in _topics(cursor.get("hears", []))),
        _ready(cursor.get("ready", "")),
        cursor.get("period", 0.1).check(_PERIOD),
        cursor.get("answer_timeout", 10.0).check(_LIMIT),
        cursor.get("start_timeout", 30.0).check(_LIMIT),
        cursor.get("run_timeout", 600.0).check(_LIMIT),
    )


def _command(system: Cursor, entries: Mapping[str, Cursor], folder: Path) -> list[str]:
    if ("command" in entries) == ("launch" in entries):
        raise _error(system, "system needs either command or launch")
    if "launch" in entries:
        return _launch(entries["launch"], system.get("arguments", {}), folder)
    if "arguments" in entries:
        reason = "arguments are those of a launch file: write them into command"
        raise _error(entries["arguments"], reason)
    command = entries["command"]
    text = _line(command)
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise _error(command, f"command = {shown(text)}: {error}") from None
    if not words:
        raise _error(command, "command is empty")
    if words[0] in ("python", "python3"):
        words[0] = sys.executable
    elif "/" in words[0]:
        _file(command, folder, words[0])
    elif shutil.which(words[0]) is None:
        raise _error(command, f"command: no program {shown(words[0])} on the PATH")
    if words[0] == sys.executable and len(words) > 1 and words[1].endswith(".py"):
        _file(command, folder, words[1])
    return words


def _launch(launch: Cursor, arguments: Cursor, folder: Path) -> list[str]:
    file = _file(launch, folder)
    if importlib.util.find_spec("launch_ros") is None:
        raise _error(
            launch,
            "launch: the Python package launch_ros is missing, which comes with an installed ROS; "
            "use command here",
        )
    words = [f"{name}:={each.value}" for name, each in _mapping(arguments).items()]
    return [sys.executable, "-m", _LAUNCHER, str(file), *words]


def _topics(cursor: Cursor) -> list[Cursor]:
    found = cursor.sequence(other="{name} = {shown} is no list")
    return [dataclasses.replace(each, name=cursor.name) for each in found]


def _answers(cursor: Cursor) -> tuple[str, ...]:
    found = _topics(cursor)
    if not found:
        raise _error(cursor, "answers names no topic: a step would not wait for the system")
    for each in found:
        name = _line(each)
        if name in TOPICS:
            raise _error(each, f"answers: {name} is a topic of the drill itself")
        if suggestion(name, COMMANDS) or name.startswith("command/"):
            _known(each, COMMANDS)
    return tuple(each.value for each in found)


def _known(cursor: Cursor, known: Collection[str]) -> str:
    name = _line(cursor)
    if name not in known:
        reason = f"{cursor.name}: the drill has no topic {shown(name)}; {did_you_mean(name, known)}"
        raise _error(cursor, reason)
    return name


def _ready(cursor: Cursor) -> str:
    if cursor.value == "":
        return ""
    text = _line(cursor)
    try:
        re.compile(text)
    except re.error as error:
        reason = f"ready = {shown(text)} is no regular expression: {error}"
        raise _error(cursor, reason) from None
    return text


# Expectations and runs.


def _expectations(
    cursor: Cursor, folder: Path, requirements: Mapping[str, str]
) -> tuple[Expectation, ...]:
    try:
        if isinstance(cursor.value, str):
            found = read_expectations(_file(cursor, folder))
        else:
            found = parse_expectations({"expectations": cursor.value})
    except ExpectationError as error:
        if not error.path:
            raise ParameterError(error) from None  # of a file of expectations, with its line
        raise _error(dataclasses.replace(cursor, place=error.path), error) from None
    for index, expectation in enumerate(found):
        if requirements and expectation.requirement not in requirements:
            where = (*cursor.place, index, "requirement")
            raise _error(
                dataclasses.replace(cursor, place=where),
                f"requirement {shown(expectation.requirement)} of {shown(expectation.name)}: "
                f"{did_you_mean(expectation.requirement, requirements)}",
            )
    return found


def _runs(entries: Mapping[str, Cursor], top: Cursor, folder: Path) -> tuple[CampaignRun, ...]:
    duration = float(entries["duration"].check(_TIME))
    drill = _drill(top.get("drill", {}), folder)
    seeds = _seeds(top.get("seeds", [0]))
    scenarios = _mapping(entries["scenarios"])
    if not scenarios:
        raise _error(entries["scenarios"], "scenarios holds no scenario")
    varied = {
        name: _variants(name, each, drill, folder)
        for name, each in _parameters(top.get("parameters", {})).items()
    }
    points = [
        dict(zip(varied, values, strict=True)) for values in itertools.product(*varied.values())
    ]
    count = len(scenarios) * len(points) * len(seeds)
    if count > _MOST_RUNS:
        raise _error(entries["scenarios"], f"{count} runs are more than {_MOST_RUNS}")
    runs: list[CampaignRun] = []
    for name, each in scenarios.items():
        cursor = dataclasses.replace(each, name=f"scenario {name}", value=each.value or {})
        entry = _mapping(cursor, _SCENARIO_KEYS)
        options = {**drill, **_own(cursor.get("parameters", {}), varied)}
        if "faults" in entry:
            options["faults"] = _faults(entry["faults"], folder)
        length = float(cursor.get("duration", duration).check(_TIME))
        label = _line(dataclasses.replace(cursor, name="scenario", value=str(name)))
        scenario: CampaignScenario | None = None
        for point, seed in itertools.product(points, seeds):
            setup = _setup({**options, **point, "seed": seed}, folder, cursor)
            scenario = scenario or CampaignScenario(label, _phrases(setup), length)
            runs.append(CampaignRun(scenario, point, setup))
    return tuple(runs)


def _drill(cursor: Cursor, folder: Path) -> dict[str, Any]:
    entries = {str(name): each for name, each in _mapping(cursor).items()}
    options = {name: _to_value(name, each.value) for name, each in entries.items()}
    for name, hint in (("seed", "give seeds"), ("faults", "give them to a scenario")):
        if name in options:
            raise _error(entries[name], f"{name} cannot be set here: {hint}")
    if isinstance(options.get("config"), str):
        _file(entries["config"], folder)
    for name in options:  # each on its own, for the line in the file
        others = {key: options[key] for key in ("config",) if key in options}
        _setup({**others, name: options[name]}, folder, entries[name])
    _setup(options, folder, cursor)
    return options


def _parameters(cursor: Cursor) -> dict[str, Cursor]:
    found = _mapping(cursor)
    for name, each in found.items():
        if name not in PARAMETERS:
            hint = did_you_mean(name, PARAMETERS)
            raise _error(each, f"{shown(name)} is no parameter; {hint}")
    return found


def _own(cursor: Cursor, varied: Mapping[str, Any]) -> dict[str, Any]:
    found = _parameters(cursor)
    for name, each in found.items():
        if name in varied:
            raise _error(each, f"{shown(name)} is varied by the campaign")
    return {name: _to_value(name, each.value) for name, each in found.items()}


def _variants(name: str, cursor: Cursor, drill: Mapping[str, Any], folder: Path) -> list[Any]:
    """Return the values of a parameter that the campaign varies."""
    entries = _filled(cursor, "values")
    values = [_to_value(name, each.value) for each in entries]
    if len({repr(value) for value in values}) < len(values):
        raise _error(cursor, f"{name} has a value twice")
    for value, each in zip(values, entries, strict=True):
        _setup({**drill, name: value}, folder, each)
    return values


def _filled(cursor: Cursor, what: str) -> list[Cursor]:
    if not (isinstance(cursor.value, list) and cursor.value):
        raise cursor.refusal(f"{{name}} = {{shown}} is no list of {what}")
    return cursor.sequence()


def _seeds(cursor: Cursor) -> list[int]:
    entries = _filled(cursor, "numbers")
    for each in entries:
        dataclasses.replace(each, name="seed").check(PARAMETERS["seed"].allowed)
    if len(set(cursor.value)) < len(entries):
        raise _error(cursor, "seeds has a number twice")
    return list(cursor.value)


def _faults(cursor: Cursor, folder: Path) -> Any:
    if isinstance(cursor.value, str) and Path(cursor.value).suffix:
        return _file(cursor, folder)
    return cursor.value


def _setup(options: Mapping[str, Any], folder: Path, cursor: Cursor) -> DrillSetup:
    try:
        return drill_setup(options, (folder,))
    except ParameterError as error:
        place = (*cursor.place, *_entry(str(error)))
        raise _error(dataclasses.replace(cursor, place=place), error) from None


def _entry(text: str) -> tuple[str | int, ...]:
    """Return the place of a fault's entry in its scenario, where an error names one."""
    found = re.search(r"faults: entry (\d+):", text)
    return ("faults", int(found[1]) - 1) if found else ()


def _phrases(setup: DrillSetup) -> tuple[str, ...]:
    faults: Sequence[Mapping[str, Any]] = yaml.safe_load(setup.scenario)["faults"]
    names = (" on ".join(filter(None, (each["kind"], each.get("channel")))) for each in faults)
    return tuple(dict.fromkeys(names))


def _to_value(name: str, value: Any) -> Any:
    """Return the value of a parameter: the file is read without truth values."""
    declaration = PARAMETERS.get(name)
    if declaration and isinstance(declaration.allowed, Flag) and value in ("true", "false"):
        return value == "true"
    return value
