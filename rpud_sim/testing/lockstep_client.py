"""Client of a drill in lockstep: without the methods that would pass the lockstep by."""

from __future__ import annotations

from typing import NoReturn

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.client import DrillClient


class LockstepClient(DrillClient):
    """Client for what ``Drill`` has no method for; time and reset belong to the lockstep."""

    def step(self, seconds: float) -> NoReturn:
        """Refuse."""
        _refuse("step", "step")

    def run_to(self, stamp: float) -> NoReturn:
        """Refuse."""
        _refuse("run_to", "step")

    def play(self) -> NoReturn:
        """Refuse."""
        _refuse("play", "step")

    def reset(self, scope: str | int = "all", seed: int | None = None) -> NoReturn:
        """Refuse."""
        _refuse("reset", "reset")


def _refuse(name: str, other: str) -> NoReturn:
    raise ParameterError(
        f"drill.client.{name} would go past the nodes under test: call drill.{other}"
    )
