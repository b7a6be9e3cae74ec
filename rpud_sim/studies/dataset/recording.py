"""Recording of a planned run: its bag and its part of each table, as a worker makes them."""

from __future__ import annotations

import dataclasses
import json
import platform
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from rpud_sim.bag.manifest import Manifest, installed_versions
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.offline_bag import write_offline_bag
from rpud_sim.simulation import EngineError
from rpud_sim.simulation.versions import engine_versions
from rpud_sim.studies.dataset import NOTICE
from rpud_sim.studies.dataset.plan import PlannedRun
from rpud_sim.studies.dataset.specification import Specification
from rpud_sim.studies.dataset.tables import make_tables
from rpud_sim.studies.processes import check_versions


@dataclasses.dataclass(frozen=True)
class Job:
    """Run that a worker records."""

    number: int  # of the run
    run: PlannedRun  # the run
    specification: Specification  # of the data set
    versions: Mapping[str, str]  # of everything that determines the results


@dataclasses.dataclass(frozen=True)
class Recorded:
    """Files of a run, by name; a run that failed has none."""

    bag: Mapping[str, bytes]  # files of the bag
    tables: Mapping[str, bytes]  # part of each table, as the content of a Parquet file
    failure: str = ""  # why the run failed, in one line; empty if it did not


def make_jobs(
    specification: Specification, runs: tuple[PlannedRun, ...], finished: frozenset[int]
) -> Iterator[Job]:
    """Yield the unfinished runs of a data set, in order."""
    versions = engine_versions()
    for run in runs:
        if run.number not in finished:
            yield Job(run.number, run, specification, versions)


def record(job: Job) -> Recorded:
    """Simulate a run; return its files.

    Raises:
        WorkerError: if this worker's versions would give other bits than those of the data set.
        OSError: if there is no room for temporary files.
    """
    check_versions(job.versions)
    run, specification = job.run, job.specification
    beginning = run.beginning(specification)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / run.name
        try:
            write_offline_bag(
                path,
                beginning,
                specification.duration,
                planned=specification.planned(run.rock),
                topics=specification.bag_topics,
                manifest=Manifest(
                    parameters={**beginning.settings.values(), "seed": run.seed},
                    scenario=_scenario_text(run),
                    # Nothing of the worker: any worker makes the same bytes.
                    command=("rpud", "dataset", NOTICE),
                    versions=installed_versions(),
                    machine=platform.machine(),
                ),
            )
        except EngineError as error:
            return Recorded({}, {}, " ".join(str(error).split()))
        tables = make_tables(path, run, specification)
        bag = {file.name: file.read_bytes() for file in sorted(path.iterdir())}
    return Recorded(bag, tables)


def _scenario_text(run: PlannedRun) -> str:
    """Return the scenario of a run, which is JSON and so YAML as well; empty without a fault."""
    if run.fault is None or run.onset is None:
        return ""
    entry = {**dataclasses.asdict(run.fault), "onset": run.onset / SECOND}
    if run.clear is not None:
        entry["duration"] = (run.clear - run.onset) / SECOND
    return json.dumps({"seed": run.seed, "faults": [entry]}) + "\n"
