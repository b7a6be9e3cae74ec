"""Artefacts of a test: bag, report page, commands, output of processes and versions."""

from __future__ import annotations

import html
import itertools
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

from rpud_sim.bag import BagError, BagWriter, QosProfile, Topic
from rpud_sim.bag.metadata import LOSSES_RECORD, Losses, losses_to_record
from rpud_sim.bag.own_records import (
    MANIFEST_RECORD,
    Manifest,
    RunVerdict,
    installed_versions,
    machine_name,
)
from rpud_sim.bag.own_records import VERDICT_RECORD as TESTED_RECORD
from rpud_sim.foundation.child_process import RPUD
from rpud_sim.foundation.json_text import json_text
from rpud_sim.messages.definitions import find_definition, find_type_hash
from rpud_sim.ros.graph import type_name
from rpud_sim.testing.drill import LockstepDrill
from rpud_sim.verdicts.verdict import FAILED

_MARKER = "artefacts.json"  # only a folder with it is overwritten
_LAST = 5  # commands in the failure's text
_NAME = re.compile(r"[^\w.=+-]+")
_LONGEST_NAME = 150
_TIME = 300.0  # that a page may take [s]


def save_artefacts(
    folder: Path, test: str, drills: Sequence[LockstepDrill], pages: Executor, failure: str = ""
) -> tuple[str, list[tuple[str, str]]]:
    """Write what a test leaves; return a text for its failure, and properties for JUnit.

    ``pages`` writes report pages later, one at a time.
    """
    place = _empty_folder(folder, test)
    lines = [f"artefacts: {place}"]
    properties = [("rpud_artefacts", str(place))]
    versions = {
        "versions": installed_versions(),
        "machine": machine_name(),
        "rmw": os.environ.get("RMW_IMPLEMENTATION", "default"),
        "command": sys.argv,
    }
    (place / "versions.json").write_text(json_text(versions, indent=2) + "\n")
    if failure:
        (place / "failure.txt").write_text(failure + "\n")
    for number, drill in enumerate(drills, 1):
        own = place if len(drills) == 1 else place / f"drill_{number}"
        own.mkdir(exist_ok=True)
        commands = [f"at {time:.3f} s: {text}" for time, text in drill.log]
        (own / "commands.txt").write_text("\n".join([*commands, ""]))
        if drill.disturbed_steps:
            steps = "\n".join(map(str, drill.disturbed_steps))
            (own / "disturbances.txt").write_text(f"{steps}\n")
            lines.append(f"disturbances: {own / 'disturbances.txt'}")
        (own / "drill.log").write_text(drill.output)
        for index, system in enumerate(drill.systems, 1):
            file = own / f"{index}_{_NAME.sub('_', system.name)}.log"
            file.write_text(f"$ {' '.join(system.command)}\n{system.output}")
        said = drill.verdict_lines or _reason(failure)
        broken = [each.at for each in drill.verdicts if each.outcome == FAILED]
        times = [at for at in broken if at is not None] or [drill.time]
        verdict = ("failed", times) if failure else ("passed", [])
        tested = RunVerdict(test, verdict[0], str(drill.seed), tuple(said), tuple(verdict[1]))
        bag, page = own / "bag", own / "report.html"
        try:
            write_bag(bag, drill, tested)
        except BagError as error:
            lines.append(f"bag: not written: {error}")
        else:
            pages.submit(_write_page, bag, page)
            properties += [("rpud_bag", str(bag)), ("rpud_report", str(page))]
            lines += [f"bag: {bag}", f"report: {page}"]
        lines += filter(None, [drill.refusals])
        lines.append(f"commands: {own / 'commands.txt'}; the last ones:")
        lines += [f"    {command}" for command in commands[-_LAST:] or ["(none)"]]
    (place / _MARKER).write_text(json_text({"test": test, **dict(properties)}, indent=2) + "\n")
    return "\n".join(lines), properties


def _reason(failure: str) -> list[str]:
    """Return the line in which pytest explains a failure, out of its text."""
    lines = failure.splitlines()
    reasons = [line.removeprefix("E  ").strip() for line in lines if line.startswith("E  ")]
    return (reasons or lines)[:1]


def _empty_folder(folder: Path, test: str) -> Path:
    name = _NAME.sub("_", test.replace("::", "-").replace("/", "-"))[-_LONGEST_NAME:].strip("_")
    for number in itertools.count(1):
        place = folder.absolute() / (name if number == 1 else f"{name}_{number}")
        if (place / _MARKER).is_file():
            shutil.rmtree(place)
        if not place.exists():
            break
    place.mkdir(parents=True)
    return place


def _write_page(bag: Path, page: Path) -> None:
    """Write the report of a bag; where that fails, the page's place has the reason."""
    command = (*RPUD, "report", str(bag), "--out", str(page))
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_TIME)
        reason = done.stderr.decode(errors="replace")
    except (OSError, subprocess.TimeoutExpired) as error:
        reason = str(error)
    if not page.exists() and page.parent.exists():  # unless the test itself has removed it
        text = html.escape(f"The report could not be written: {reason}")
        page.write_text(f"<pre>{text}</pre>")


def write_bag(path: Path, drill: LockstepDrill, tested: RunVerdict | None = None) -> None:
    """Write a bag of all that was published since the test began; its clock is simulation time."""
    manifest = Manifest(
        node=f"{drill.namespace}/drill_node",
        scenario=None,
        command=tuple(sys.argv),
        versions=installed_versions(),
        machine=machine_name(),
    )
    entries = []
    journal = f"{drill.namespace}/journal"
    with BagWriter(path) as bag:
        bag.add_record(MANIFEST_RECORD, manifest.to_record())
        if tested is not None:
            bag.add_record(TESTED_RECORD, tested.to_record())
        for name, heard in sorted(drill.heard.items()):
            if name == f"{drill.namespace}/waveform":  # large, and the trajectory has it all
                continue
            kind = type_name(heard.kind)
            offer = QosProfile(durability="transient_local" if heard.latched else "volatile")
            try:
                definition, type_hash = find_definition(kind), find_type_hash(kind)
            except BagError:  # of a package whose definitions are not installed
                definition, type_hash = None, ""
            bag.add_topic(Topic(name, kind, type_hash, (offer,)), definition)
            payloads = heard.payloads
            if name == journal:  # the bag lacks the entries of the runs before
                payloads = [drill.beginning, *payloads[1:]]
            entries += [
                (stamp, name, payload)
                for stamp, payload in zip(heard.stamps, payloads, strict=True)
            ]
        # The journal comes before what follows at its time.
        entries.sort(key=lambda entry: (entry[0], entry[1] != journal))
        for stamp, name, payload in entries:
            bag.write(name, payload, max(stamp, 0), max(stamp, 0))
        losses = {name: Losses(transport=heard.lost) for name, heard in drill.heard.items()}
        bag.add_record(LOSSES_RECORD, losses_to_record(losses))
