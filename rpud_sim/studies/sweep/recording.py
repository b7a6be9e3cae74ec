"""Bag of a simulation of a sweep, as a worker makes it."""

from __future__ import annotations

import dataclasses
import json
import platform
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpud_sim.bag.manifest import Manifest, installed_versions
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.offline_bag import write_offline_bag
from rpud_sim.simulation.run import Beginning
from rpud_sim.studies.sweep.plan import PlannedRun
from rpud_sim.studies.sweep.specification import SweepSpecification


def record_bag(
    specification: SweepSpecification, point: Mapping[str, Any], run: PlannedRun, phase: float
) -> dict[str, bytes]:
    """Simulate a run; return the files of its bag by name.

    Raises:
        EngineError: if the run cannot go on.
        OSError: if there is no room for temporary files.
    """
    beginning = Beginning(specification.settings(point), phase, run.seed, run.scenario)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / run.name
        write_offline_bag(
            path,
            beginning,
            specification.duration,
            planned=specification.planned(point),
            topics=specification.bag_topics,
            manifest=Manifest(
                parameters={**beginning.settings.values(), "seed": run.seed},
                scenario=_scenario_text(run),
                # Nothing of the worker: any worker makes the same bytes.
                command=("rpud", "sweep"),
                versions=installed_versions(),
                machine=platform.machine(),
            ),
        )
        return {file.name: file.read_bytes() for file in sorted(path.iterdir())}


def _scenario_text(run: PlannedRun) -> str:
    """Return the scenario of a run, which is JSON and so YAML as well; empty without a fault."""
    if run.fault is None or run.onset is None:
        return ""
    entry = {**dataclasses.asdict(run.fault), "onset": run.onset / SECOND}
    if run.clear is not None:
        entry["duration"] = (run.clear - run.onset) / SECOND
    return json.dumps({"seed": run.seed, "faults": [entry]}) + "\n"
