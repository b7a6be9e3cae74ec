"""Fork of a recorded run: its state at any instant, from which a bag or a drill node goes on."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping
from typing import Any

import rpud_sim.bag
from rpud_sim.bag import BagFormatError, BagReader
from rpud_sim.bag.manifest import MANIFEST_RECORD, manifest_from_record
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.recorded_run import ForkError, RecordedRun, find_run
from rpud_sim.simulation.changes import Changes, apply_change, apply_parameters
from rpud_sim.simulation.configuration import PARAMETERS, Settings
from rpud_sim.simulation.fields import Fields
from rpud_sim.simulation.rerun import JournalError
from rpud_sim.simulation.resumption import Resumed, Start, resume
from rpud_sim.simulation.run import Run

# Parameters of a node that a live fork may have otherwise, for they change no bit.
LIVE = ("autostart", "publish_clock", "start_paused", "thread_priority")


@dataclasses.dataclass(frozen=True)
class Fork:
    """Recorded run at the instant of a fork, and where it came from."""

    recorded: RecordedRun  # the run of the bag
    time: int  # instant, in simulation time [ns]
    resumed: Resumed  # the run in its state there
    # messages of the journal up to there, with the times at which they were published
    history: tuple[tuple[int, Fields], ...]
    origin: Mapping[str, Any]  # the manifest's ``forked_from``
    scenario: str | None  # text of the scenario, if the bag has it


def open_fork(
    path: str | os.PathLike[str],
    at: float,
    changes: Changes,
    *,
    run: int = 1,
    topic: str | None = None,
    stop: bool,
    report: Callable[[float], object] = lambda seconds: None,
) -> Fork:
    """Run a recorded run again up to an instant, in simulation time of the run [s].

    Runs count from 1; ``topic`` chooses one of several journals. ``stop`` is exactly at the
    instant.
    """
    with rpud_sim.bag.open(path) as bag:
        recorded = find_run(bag, run, topic)
        scenario = _scenario(bag)
    time = round(at * SECOND)
    _check_instant(recorded, time, at)
    recorded.check_engine()
    try:
        resumed = resume(recorded.necessary(time), time, stop=stop, report=report)
    except JournalError as error:
        raise ForkError(f"{recorded.journal}: {error}") from error
    history = tuple(
        (message.publish_time, recorded.fields(message)) for message, _ in recorded.history(time)
    )
    origin = {
        "bag": os.fspath(path),
        "run": run,
        "at": time / SECOND,
        "journal": recorded.digest(time),
        "changes": _to_json(changes),
    }
    return Fork(recorded, time, resumed, history, origin, scenario)


def live_start(fork: Fork, changes: Changes) -> Start:
    """Return the start of a drill node in the state of a fork.

    Recorded changes after the instant are not repeated, for others command a node. Scheduled ends
    of faults and the rest of the scenario are part of the state. The fork must have stopped at its
    instant; its run is used up.
    """
    run = fork.resumed.run
    settings = begin_changes(run, fork.resumed.settings, changes)
    entries = (*fork.resumed.entries, *run.changes())
    # The scenario is part of the state, and its file may be another one by now.
    fixed: dict[str, Any] = {"scenario": "", "autostart": True, **_of_node(changes.parameters)}
    if run.beginning.seed <= PARAMETERS["seed"].allowed.maximum:  # type: ignore[union-attr]
        fixed["seed"] = run.beginning.seed
    return Start(
        run,
        settings.replace(fixed),
        (
            *(fields for _, fields in fork.history),
            *(fields for _, name, fields in entries if name == "journal"),
        ),
        tuple(
            dataclasses.replace(planned, delay=fork.time + planned.delay)
            for planned in changes.planned
            if planned.delay
        ),
        fork.origin,
    )


def begin_changes(run: Run, settings: Settings, changes: Changes) -> Settings:
    """Make the changes that come at the instant of the fork; return the settings in force."""
    run.control.adopt()
    settings = apply_parameters(run, settings, changes.parameters)
    for planned in changes.planned:
        if planned.delay == 0:
            apply_change(run, planned.change)
    return settings


def _of_node(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in LIVE}


def _check_instant(recorded: RecordedRun, time: int, at: float) -> None:
    start, end = recorded.start / SECOND, recorded.end / SECOND
    if recorded.start <= time <= recorded.end:
        return
    given = f"--at = {at:.9g} s"
    if time > recorded.end and recorded.torn:
        raise ForkError(
            f"{given}: the journal is complete up to {end:.9g} s alone: {recorded.torn}"
        )
    which = f"run {recorded.number} of {recorded.runs}" if recorded.runs > 1 else "the run"
    raise ForkError(f"{given} is outside {which} of the bag: [{start:.9g}, {end:.9g}] s")


def _scenario(bag: BagReader) -> str | None:
    try:
        records = bag.records(MANIFEST_RECORD)
        return manifest_from_record(records[0]).scenario if records else None
    except BagFormatError:
        return None


def _to_json(changes: Changes) -> dict[str, Any]:
    return {
        "parameters": dict(changes.parameters),
        "replaces_commands": changes.replaces_commands,
        "planned": [
            {
                "delay": planned.delay / SECOND,
                type(planned.change).__name__: dataclasses.asdict(planned.change),
            }
            for planned in changes.planned
        ],
    }
