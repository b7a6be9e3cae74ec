"""Control of simulation time: playing, paused, stopped at its start, or stepping to a goal."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future
from typing import NamedTuple


class InterruptedStepError(RuntimeError):
    """A step that ended before its goal; the text says why."""


class Reached(NamedTuple):
    """End of a step."""

    stamp: int  # of the simulation time that was reached [ns]
    published: Mapping[str, int]  # messages by topic until then, since its publisher exists


class TimeControl:
    """State of simulation time: paused at first. One thread changes it; any may read it."""

    def __init__(self) -> None:
        self._playing = False
        self._at_start = False
        self._goal: int | None = None
        self._step: Future[Reached] = Future()

    @property
    def playing(self) -> bool:
        return self._playing

    @property
    def at_start(self) -> bool:
        """Whether it was stopped, and neither paused nor played since."""
        return self._at_start

    @property
    def goal(self) -> int | None:
        """Simulation time at which the present step ends [ns]; None without a step."""
        return self._goal

    @property
    def stepping(self) -> bool:
        return self._goal is not None

    @property
    def state(self) -> str:
        """State of an active drill, as ``rpud_msgs/Status`` names it."""
        if self._playing or self.stepping:
            return "running"
        return "stopped" if self._at_start else "paused"

    def play(self) -> None:
        """Let time go on by itself; a step is interrupted."""
        self.interrupt("the simulation was set to play")
        self._playing, self._at_start = True, False

    def pause(self) -> None:
        """Hold time; a step is interrupted."""
        self.interrupt("the simulation was paused")
        self._playing = self._at_start = False

    def stop(self) -> None:
        """Hold time at its start; a step is interrupted."""
        self.interrupt("the simulation was stopped")
        self._playing, self._at_start = False, True

    def step(self, goal: int) -> Future[Reached]:
        """Begin a step to a simulation time [ns]."""
        self._goal = goal
        self._step = Future()
        return self._step

    def complete_step(self, time: int) -> Future[Reached] | None:
        """Return the step whose goal a simulation time [ns] reaches, None if there is none.

        The step is over then. Its result is for the caller to set, after the status is published.
        """
        if self._goal is None or time < self._goal:
            return None
        self._goal = None
        return self._step

    def interrupt(self, reason: str) -> None:
        """End a step that is under way before its goal, with an ``InterruptedStepError``."""
        if self._goal is not None:
            self._goal = None
            self._step.set_exception(InterruptedStepError(reason))
