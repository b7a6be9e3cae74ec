"""Campaign files in YAML: read and checked whole, before anything starts."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from rpud_sim.foundation.quantities import Flag, ParameterError, Quantity, did_you_mean, shown
from rpud_sim.foundation.yaml_files import read_yaml_text, yaml_lines
from rpud_sim.simulation.configuration import PARAMETERS
from rpud_sim.testing.campaign.entries import (
    Place,
    check_keys,
    find_file,
    mapping,
    number,
    one_line,
)
from rpud_sim.testing.campaign.specification import (
    CampaignError,
    CampaignRun,
    CampaignScenario,
    CampaignSpecification,
)
from rpud_sim.testing.campaign.system_entry import to_system
from rpud_sim.testing.setup import DrillSetup, drill_setup
from rpud_sim.verdicts import Expectation, ExpectationError, read_expectations
from rpud_sim.verdicts.notation import parse_expectations

_KEYS = (
    "name",
    "requirements",
    "system",
    "drill",
    "duration",
    "scenarios",
    "parameters",
    "seeds",
    "expectations",
)
_SCENARIO_KEYS = ("faults", "duration", "parameters")
_TIME = Quantity("s", "simulation time of a run", 0.0, 1e5, exclusive=True)
_MOST_RUNS = 100_000


def read_campaign(path: str | Path) -> CampaignSpecification:
    """Return the campaign of a file; relative paths in it begin at its folder.

    Raises:
        CampaignError: if anything in it cannot be used; one line with the file's name and line.
    """
    file = Path(path)
    try:
        # Without truth values: off is a kind of fault.
        content, text = read_yaml_text(file, truth_values=False)
    except ParameterError as error:
        raise CampaignError(error) from None
    try:
        return _campaign(content, file)
    except (CampaignError, ExpectationError) as error:
        if isinstance(error, ExpectationError) and not error.path:
            raise CampaignError(error) from None  # of a file of expectations, with its line
        lines = yaml_lines(text) if content is not None else {}
        place = error.path
        while place and place not in lines:
            place = place[:-1]
        raise CampaignError(f"{path}:{lines.get(place, 1)}: {error}", error.path) from None


def _campaign(content: Any, file: Path) -> CampaignSpecification:
    entries = mapping("the file", content, ())
    check_keys(entries, _KEYS, (), ("system", "duration", "scenarios", "expectations"))
    folder = file.parent.absolute()
    name = one_line("name", entries.get("name", file.stem), ("name",))
    requirements = _requirements(entries.get("requirements", {}))
    system = to_system(entries["system"], folder)
    expectations = _expectations(entries["expectations"], folder, requirements)
    return CampaignSpecification(name, requirements, system, _runs(entries, folder), expectations)


def _requirements(content: Any) -> dict[str, str]:
    entries = mapping("requirements", content, ("requirements",))
    return {
        str(key): one_line(str(key), value, ("requirements", str(key)))
        for key, value in entries.items()
    }


def _expectations(
    content: Any, folder: Path, requirements: Mapping[str, str]
) -> tuple[Expectation, ...]:
    place: Place = ("expectations",)
    if isinstance(content, str):
        file = find_file(content, folder, "expectations", place)
        found = read_expectations(file)
        places: list[Place] = [place] * len(found)
    else:
        found = parse_expectations({"expectations": content})
        places = [(*place, index, "requirement") for index in range(len(found))]
    for expectation, where in zip(found, places, strict=True):
        if requirements and expectation.requirement not in requirements:
            raise CampaignError(
                f"requirement {shown(expectation.requirement)} of {shown(expectation.name)}: "
                f"{did_you_mean(expectation.requirement, requirements)}",
                where,
            )
    return found


def _runs(entries: Mapping[Any, Any], folder: Path) -> tuple[CampaignRun, ...]:
    duration = number("duration", entries["duration"], _TIME, ("duration",))
    drill = _drill(entries.get("drill", {}), folder)
    seeds = _seeds(entries.get("seeds", [0]))
    scenarios = mapping("scenarios", entries["scenarios"], ("scenarios",))
    if not scenarios:
        raise CampaignError("scenarios holds no scenario", ("scenarios",))
    varied = _varied(entries.get("parameters", {}))
    for name, values in varied.items():
        for index, value in enumerate(values):  # each on its own, for the line in the file
            _setup({**drill, name: value}, folder, ("parameters", name, index))
    points = [
        dict(zip(varied, values, strict=True)) for values in itertools.product(*varied.values())
    ]
    count = len(scenarios) * len(points) * len(seeds)
    if count > _MOST_RUNS:
        raise CampaignError(f"{count} runs are more than {_MOST_RUNS}", ("scenarios",))
    runs: list[CampaignRun] = []
    for name, content in scenarios.items():
        place: Place = ("scenarios", str(name))
        entry = mapping(f"scenario {name}", content or {}, place)
        check_keys(entry, _SCENARIO_KEYS, place)
        own = _own(entry.get("parameters", {}), varied, (*place, "parameters"))
        length = number("duration", entry.get("duration", duration), _TIME, (*place, "duration"))
        scenario: CampaignScenario | None = None
        for point in points:
            for seed in seeds:
                options = {**drill, **own, **point, "seed": seed}
                if "faults" in entry:
                    options["faults"] = _faults(entry["faults"], folder, (*place, "faults"))
                setup = _setup(options, folder, place)
                scenario = scenario or CampaignScenario(
                    one_line("scenario", str(name), place), _phrases(setup), length
                )
                runs.append(CampaignRun(scenario, point, setup))
    return tuple(runs)


def _drill(content: Any, folder: Path) -> dict[str, Any]:
    place: Place = ("drill",)
    entries = mapping("drill", content, place)
    options = {str(name): _to_value(str(name), value) for name, value in entries.items()}
    for name, hint in (("seed", "give seeds"), ("faults", "give them to a scenario")):
        if name in options:
            raise CampaignError(f"{name} cannot be set here: {hint}", (*place, name))
    if isinstance(options.get("config"), str):
        find_file(options["config"], folder, "config", (*place, "config"))
    for name in options:
        others = {key: options[key] for key in ("config",) if key in options and key != name}
        _setup({**others, name: options[name]}, folder, (*place, name))
    _setup(options, folder, place)
    return options


def _parameters(content: Any, place: Place) -> dict[str, Any]:
    values = mapping("parameters", content, place)
    for name in values:
        if name not in PARAMETERS:
            hint = did_you_mean(name, PARAMETERS)
            raise CampaignError(f"{shown(name)} is no parameter; {hint}", (*place, str(name)))
    return dict(values)


def _own(content: Any, varied: Mapping[str, Any], place: Place) -> dict[str, Any]:
    values = _parameters(content, place)
    for name in values:
        if name in varied:
            raise CampaignError(f"{shown(name)} is varied by the campaign", (*place, name))
    return {name: _to_value(name, value) for name, value in values.items()}


def _varied(content: Any) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for name, values in _parameters(content, ("parameters",)).items():
        place = ("parameters", name)
        if not isinstance(values, list) or not values:
            raise CampaignError(
                f"{name} = {shown(values)} is no list of values", ("parameters", name)
            )
        found[name] = [_to_value(name, value) for value in values]
        if len({repr(value) for value in found[name]}) < len(values):
            raise CampaignError(f"{name} has a value twice", place)
    return found


def _seeds(content: Any) -> list[int]:
    if not isinstance(content, list) or not content:
        raise CampaignError(f"seeds = {shown(content)} is no list of numbers", ("seeds",))
    for index, seed in enumerate(content):
        try:
            PARAMETERS["seed"].allowed.check("seed", seed)
        except ParameterError as error:
            raise CampaignError(error, ("seeds", index)) from None
    if len(set(content)) < len(content):
        raise CampaignError("seeds has a number twice", ("seeds",))
    return list(content)


def _faults(content: Any, folder: Path, place: Place) -> Any:
    if isinstance(content, str) and Path(content).suffix:
        return find_file(content, folder, "faults", place)
    return content


def _setup(options: Mapping[str, Any], folder: Path, place: Place) -> DrillSetup:
    try:
        return drill_setup(options, (folder,))
    except ParameterError as error:
        raise CampaignError(error, _narrowed(place, str(error))) from None


def _narrowed(place: Place, text: str) -> Place:
    """Return the place of a fault's entry, where an error names one."""
    _, found, rest = text.partition("faults: entry ")
    entry = rest.partition(":")[0]
    return (*place, "faults", int(entry) - 1) if found and entry.isdecimal() else place


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
