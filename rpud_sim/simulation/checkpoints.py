"""Checkpoints: named states of a run, to which a drill can go back."""

from __future__ import annotations

import re

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.simulation.run import Run

# Checkpoints that are kept. One takes well below a megabyte at the default rates.
MOST_CHECKPOINTS = 16

_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")


class CheckpointError(ParameterError):
    """Checkpoint that cannot be saved or restored; the text says why, in one line."""


class Checkpoints:
    """Named states of runs, in memory; at most ``MOST_CHECKPOINTS``."""

    def __init__(self) -> None:
        self._runs: dict[str, Run] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the checkpoints, the oldest first."""
        return tuple(self._runs)

    def save(self, name: str, run: Run) -> None:
        """Keep the present state of a run; an older one of the same name is discarded.

        Raises:
            CheckpointError: if the name cannot be one, or there are too many.
        """
        if not (isinstance(name, str) and _NAME.fullmatch(name)):
            raise CheckpointError(
                f"{shown(name)} is no name of a checkpoint: 1 to 64 letters, digits, _, . and -"
            )
        if name not in self._runs and len(self._runs) >= MOST_CHECKPOINTS:
            raise CheckpointError(
                f"{shown(name)} would be one more than {MOST_CHECKPOINTS} checkpoints: "
                f"give the name of one to replace, such as {next(iter(self._runs))}"
            )
        state = run.copy()
        self._runs.pop(name, None)
        self._runs[name] = state

    def find(self, name: str) -> Run:
        """Return a new run in the state of a checkpoint, which stays."""
        if name not in self._runs:
            known = did_you_mean(name, self._runs) if self._runs else "none was saved"
            raise CheckpointError(f"there is no checkpoint {shown(name)}; {known}")
        run = self._runs[name].copy()
        run.begin_streams()  # what was pending is of the time before the checkpoint
        return run
