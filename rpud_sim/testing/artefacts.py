"""Artefacts of a test: bag, report page, commands, output of processes and versions."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rpud_sim.bag import BagError, BagWriter, QosProfile, Topic
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.losses import LOSSES_RECORD, Losses, losses_to_record
from rpud_sim.bag.manifest import (
    MANIFEST_RECORD,
    Manifest,
    RunVerdict,
    installed_versions,
    machine_name,
)
from rpud_sim.bag.manifest import VERDICT_RECORD as TESTED_RECORD
from rpud_sim.testing.drill import Drill
from rpud_sim.testing.report_pages import ReportPages

_MARKER = "artefacts.json"  # only a folder with it is overwritten
_LAST = 5  # commands in the failure's text
_NAME = re.compile(r"[^\w.=+-]+")
_LONGEST_NAME = 150


@dataclasses.dataclass(frozen=True)
class Artefacts:
    """What a test has left."""

    text: str  # for the failure
    properties: tuple[tuple[str, str], ...]  # names and values for JUnit


def leave_artefacts(
    folder: Path, test: str, drills: Sequence[Drill], reports: ReportPages, failure: str = ""
) -> Artefacts:
    place = _empty_folder(folder, test)
    lines = [f"artefacts: {place}"]
    properties = [("rpud_artefacts", str(place))]
    (place / "versions.json").write_text(json.dumps(_versions(), indent=2) + "\n")
    if failure:
        (place / "failure.txt").write_text(failure + "\n")
    for number, drill in enumerate(drills, 1):
        own = place if len(drills) == 1 else place / f"drill_{number}"
        own.mkdir(exist_ok=True)
        commands = [f"at {time:.3f} s: {text}" for time, text in drill.log]
        (own / "commands.txt").write_text("\n".join([*commands, ""]))
        (own / "drill.log").write_text(drill.output)
        for index, system in enumerate(drill.systems, 1):
            file = own / f"{index}_{_NAME.sub('_', system.name)}.log"
            file.write_text(f"$ {' '.join(system.command)}\n{system.output}")
        said = drill.verdict_lines or failure.splitlines()[:1]
        tested = RunVerdict(test, "failed" if failure else "passed", str(drill.seed), tuple(said))
        lines += _bag_and_report(own, drill, properties, reports, tested)
        lines.append(f"commands: {own / 'commands.txt'}; the last ones:")
        lines += [f"    {command}" for command in commands[-_LAST:] or ["(none)"]]
    (place / _MARKER).write_text(json.dumps({"test": test, **dict(properties)}, indent=2) + "\n")
    return Artefacts("\n".join(lines), tuple(properties))


def write_bag(path: Path, drill: Drill, tested: RunVerdict | None = None) -> None:
    """Write a bag of all that was published since the test began; its clock is simulation time."""
    manifest = Manifest(
        node=f"{drill.namespace}/drill_node",
        scenario=None,
        command=tuple(sys.argv),
        versions=installed_versions(),
        machine=machine_name(),
    )
    entries = []
    with BagWriter(path) as bag:
        bag.add_record(MANIFEST_RECORD, manifest.to_record())
        if tested is not None:
            bag.add_record(TESTED_RECORD, tested.to_record())
        for name, heard in sorted(drill.heard.items()):
            kind = _type_name(heard.kind)
            offer = QosProfile(durability="transient_local" if heard.latched else "volatile")
            try:
                definition, type_hash = find_definition(kind), find_type_hash(kind)
            except BagError:  # of a package whose definitions are not installed
                definition, type_hash = None, ""
            bag.add_topic(Topic(name, kind, type_hash, (offer,)), definition)
            entries += [
                (stamp, name, payload)
                for stamp, payload in zip(heard.stamps, heard.payloads, strict=True)
            ]
        journal = f"{drill.namespace}/journal"  # it comes before what follows at its time
        entries.sort(key=lambda entry: (entry[0], entry[1] != journal))
        for stamp, name, payload in entries:
            bag.write(name, payload, max(stamp, 0), max(stamp, 0))
        losses = {name: Losses(transport=heard.lost) for name, heard in drill.heard.items()}
        bag.add_record(LOSSES_RECORD, losses_to_record(losses))


def _bag_and_report(
    folder: Path,
    drill: Drill,
    properties: list[tuple[str, str]],
    reports: ReportPages,
    tested: RunVerdict,
) -> list[str]:
    bag, page = folder / "bag", folder / "report.html"
    try:
        write_bag(bag, drill, tested)
    except BagError as error:
        return [f"bag: not written: {error}"]
    reports.begin(bag, page)
    properties += [("rpud_bag", str(bag)), ("rpud_report", str(page))]
    return [f"bag: {bag}", f"report: {page}"]


def _empty_folder(folder: Path, test: str) -> Path:
    name = _NAME.sub("_", test.replace("::", "-").replace("/", "-"))[-_LONGEST_NAME:].strip("_")
    place = folder.absolute() / name
    number = 1
    while place.exists():
        if (place / _MARKER).is_file():
            shutil.rmtree(place)
            break
        number += 1
        place = place.with_name(f"{name}_{number}")
    place.mkdir(parents=True)
    return place


def _versions() -> Mapping[str, object]:
    return {
        "versions": installed_versions(),
        "machine": machine_name(),
        "rmw": os.environ.get("RMW_IMPLEMENTATION", "default"),
        "command": sys.argv,
    }


def _type_name(kind: type) -> str:
    package, _, rest = kind.__module__.partition(".")
    return f"{package}/{rest.split('.')[0]}/{kind.__name__}"
