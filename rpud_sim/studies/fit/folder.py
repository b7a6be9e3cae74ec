"""Folder of a fit: finished simulations appear at once, so that a fit can be resumed."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.whole_folder import whole_file
from rpud_sim.simulation.ensemble import compile_kernels, compile_members
from rpud_sim.simulation.versions import engine_versions, version_of
from rpud_sim.studies.fit.design import Chunk, make_chunks, simulate
from rpud_sim.studies.fit.specification import Specification
from rpud_sim.studies.held_folder import held_folder
from rpud_sim.studies.processes import run_on_processes

_SIMULATIONS = "simulations"

Report = Callable[[int], None]  # called with the number of runs that finished since its last call


def fit_versions() -> dict[str, str]:
    """Return the versions of everything that a fit's results depend on."""
    return engine_versions() | {"scipy": version_of("scipy")}


def make_manifest(specification: Specification) -> dict[str, Any]:
    """Return everything that a fit's results depend on, as JSON reads it back."""
    content = {"specification": specification.content(), "versions": fit_versions()}
    found: dict[str, Any] = json.loads(json.dumps(content))
    return found


class FitFolder:
    """Files of one fit."""

    def __init__(
        self, path: Path, specification: Specification, workers: int, report: Report
    ) -> None:
        self.path = path
        self._specification = specification
        self._manifest = make_manifest(specification)
        self._workers = workers
        self.report = report
        self.simulated = 0
        self.kept = 0

    def held(self) -> contextlib.AbstractContextManager[None]:
        """Create or open the folder, and lock it against other processes; see ``held_folder``."""
        return held_folder(self.path, self._manifest, "fit", ParameterError)

    def simulate(
        self, job: str, points: Sequence[Mapping[str, Any]], repeat: int, seed: Sequence[int]
    ) -> np.ndarray:
        """Return the measures at points; those that an earlier call has simulated are read.

        Args:
            job: name of the work, different for each.
            repeat: runs at each point.

        Returns:
            The measures, shape (points, repeat, targets).
        """
        chunks = make_chunks(self._specification, points, repeat, seed)
        found = {chunk.number: self._read(job, chunk) for chunk in chunks}
        missing = [chunk for chunk in chunks if found[chunk.number] is None]
        kept = repeat * sum(len(c.points) for c in chunks if found[c.number] is not None)
        self.kept += kept
        self.report(kept)
        if missing:
            # Compiled here once: the workers then find the kernels in the cache.
            condition = self._specification.conditions[0]
            configuration = self._specification.configuration(points[0], condition)
            compile_members(configuration)
            compile_kernels(configuration)  # of figures that are sampled
            with contextlib.closing(run_on_processes(simulate, missing, self._workers)) as outcomes:
                for chunk, outcome in outcomes:
                    self._write(job, chunk, outcome)
                    found[chunk.number] = outcome
                    self.simulated += len(chunk.points) * repeat
                    self.report(len(chunk.points) * repeat)
        return np.concatenate([found[chunk.number] for chunk in chunks])

    def write(self, name: str, content: bytes) -> None:
        """Write a file of the folder."""
        with whole_file(self.path / name) as unfinished:
            unfinished.write_bytes(content)

    def _path(self, job: str, chunk: Chunk) -> Path:
        return self.path / _SIMULATIONS / f"{job}_{chunk.number:05}.npy"

    def _read(self, job: str, chunk: Chunk) -> np.ndarray | None:
        """Return the measures of a chunk; None if the file is missing or torn by a power loss."""
        shape = (*chunk.phases.shape[:2], len(self._specification.targets))
        try:
            found = np.load(self._path(job, chunk), allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        return found if found.shape == shape else None

    def _write(self, job: str, chunk: Chunk, outcome: np.ndarray) -> None:
        path = self._path(job, chunk)
        path.parent.mkdir(exist_ok=True)
        with whole_file(path) as unfinished, unfinished.open("wb") as file:
            np.save(file, outcome, allow_pickle=False)
