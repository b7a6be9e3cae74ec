"""Drills that tests ask for: their options, checked before anything starts."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from rpud_sim.foundation.options import NAMESPACE, NO_SEED
from rpud_sim.foundation.quantities import (
    ParameterError,
    did_you_mean,
    short_name,
    short_repr,
)
from rpud_sim.foundation.yaml_files import YamlNode, open_yaml, yaml_node
from rpud_sim.simulation.changes import Inject
from rpud_sim.simulation.configuration import (
    PARAMETERS,
    Configuration,
    read_parameter_file,
    to_settings,
)
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, check_supported
from rpud_sim.simulation.scenario_file import scenario_at
from rpud_sim.testing.processes import LOCKSTEP, NO_FAULTS

_OWN = ("config", "faults", "seed", "namespace")
_RESERVED: Mapping[str, str] = {
    **dict.fromkeys((*LOCKSTEP, "autostart"), "a drill of a test runs in lockstep"),
    "scenario": "give faults=...",
}


@dataclasses.dataclass(frozen=True)
class DrillSetup:
    """Drill of a test."""

    # of the drill by name, without the lockstep's own, the scenario and the seed
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    seed: int = (
        NO_SEED  # of the run; a reset always sets it, so that no test depends on the one before
    )
    scenario: str = NO_FAULTS  # content of a scenario file
    namespace: str = NAMESPACE  # of the node
    faults: tuple[Fault, ...] = ()  # of the scenario, in the order of their onsets

    @property
    def all_parameters(self) -> dict[str, Any]:
        """The parameters, with the defaults of those that are not given."""
        values = to_settings(self.parameters).values()
        return {name: value for name, value in values.items() if name not in _RESERVED}


def drill_setup(
    options: Mapping[str, Any], folders: Sequence[Path] = (), place: YamlNode | None = None
) -> DrillSetup:
    """Return the drill that options describe.

    Options are ``config``, a ROS parameter file; ``faults``, a scenario file, or a list of kinds
    and of entries as a scenario file has them; ``seed``; ``namespace``; and parameters of the drill
    by name, which go before the file's. ``folders`` are where relative paths are
    looked for, before the working directory. ``place`` is where the options are in a file, if any.
    """
    known = [*_OWN, *(name for name in PARAMETERS if name not in _RESERVED)]
    for name in options:
        if name in _RESERVED:
            raise ParameterError(f"{name} cannot be set: {_RESERVED[name]}")
        if name not in known:
            raise ParameterError(
                f"{short_name(name)} is neither a parameter of the drill nor one of "
                f"{', '.join(_OWN)}{did_you_mean(name, known)}"
            )
    namespace = options.get("namespace", NAMESPACE)
    if not (isinstance(namespace, str) and namespace.startswith("/") and namespace.strip("/")):
        raise ParameterError(f"namespace = {short_repr(namespace)} is not of the form /name")
    folders = (*folders, Path())
    values: dict[str, Any] = {}
    faults = options.get("faults")
    if options.get("config") is not None:
        file = find_file(options["config"], "config", folders)
        values = read_parameter_file(file, f"{namespace}/drill_node")
        if values.get("scenario") and faults is None:
            faults = find_file(values["scenario"], "scenario", (file.parent, *folders))
    values.update((name, options[name]) for name in options if name not in _OWN)
    if options.get("seed") is not None:
        values["seed"] = options["seed"]
    for name in _RESERVED:
        values.pop(name, None)
    settings = to_settings(values)
    values.pop("seed", None)
    scenario, injected = NO_FAULTS, tuple[Fault, ...]()
    if faults is not None:
        place = place or yaml_node(options, "faults")
        scenario, injected = _scenario(faults, folders, settings.configuration, place)
    return DrillSetup(values, settings.seed, scenario, namespace, injected)


def find_file(given: Any, name: str, folders: Sequence[Path]) -> Path:
    """Return the file of a path that may be relative to one of some folders."""
    if not isinstance(given, str | Path):
        raise ParameterError(f"{name} = {short_repr(given)} is not a path")
    places = [folder / given for folder in folders]
    for place in places:
        if os.path.isfile(place):  # False for a name that no file can have
            return place.resolve()
    parents = [place.parent for place in places if os.path.isdir(place.parent)]
    beside = [each.name for parent in parents for each in parent.iterdir()]
    looked = ", ".join(dict.fromkeys(map(str, places)))
    hint = did_you_mean(Path(given).name, beside, others=False)
    raise ParameterError(
        f"{name} = {short_repr(str(given))} is not a file: looked for {looked}{hint}"
    )


def _scenario(
    faults: Any, folders: Sequence[Path], configuration: Configuration, place: YamlNode
) -> tuple[str, tuple[Fault, ...]]:
    """Return the content of a scenario file, and its faults."""
    if isinstance(faults, str) and faults not in KINDS and not Path(faults).suffix:
        raise ParameterError(
            f"faults = {short_repr(faults)} is neither a file nor a kind of fault"
            f"{did_you_mean(faults, KINDS)}"
        )
    if isinstance(faults, Path) or (isinstance(faults, str) and faults not in KINDS):
        file = find_file(faults, "faults", folders)
        top = open_yaml(file)
    else:
        entries = [faults] if isinstance(faults, str | Mapping) else faults
        if not isinstance(entries, list | tuple):
            raise ParameterError(
                f"faults = {short_repr(faults)} is neither a file nor a list of faults"
            )
        found = [{"kind": e, "onset": 0.0} if isinstance(e, str) else e for e in entries]
        content = {"faults": [dict(e) if isinstance(e, Mapping) else e for e in found]}
        top = dataclasses.replace(place, value=content, name="")
    changes = [(each.action, each.place) for each in scenario_at(top)]
    scheduled = [(each.fault, prefix) for each, prefix in changes if isinstance(each, Inject)]
    for fault, prefix in scheduled:
        try:
            check_supported(fault, configuration)
        except ParameterError as error:
            raise ParameterError(f"{prefix}{error}") from None
    return yaml.safe_dump(top.value), tuple(fault for fault, _ in scheduled)
