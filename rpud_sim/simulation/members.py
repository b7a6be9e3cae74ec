"""Runs without commands, of which statistics are kept and no records: members of ensembles.

Compiled code runs them from start to end (``tally.advance_members``). Their figures are those of a
``Simulation`` to the last bit.
"""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Sequence

import numpy as np

from rpud_sim.drilling.rock import Progress
from rpud_sim.drilling.rotor import RotorWork
from rpud_sim.foundation.time import SECOND, split_fraction
from rpud_sim.model.drill import Drill, derive
from rpud_sim.model.energy import RpudConstants
from rpud_sim.model.engine import EngineError, failure, initial_state
from rpud_sim.model.events import DONE
from rpud_sim.model.resonator import account
from rpud_sim.model.segment import IMPACT, SEGMENT
from rpud_sim.model.tally import CLASSES, PART_ROOM, advance_members, empty_tallies
from rpud_sim.simulation.actuator import Actuator
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount
from rpud_sim.simulation.plant import nominal_drive, rpud_constants
from rpud_sim.simulation.scenario import Scenario
from rpud_sim.simulation.statistics import Statistics, figures_of

_FIRST_IMPACTS = 1024  # room for impacts; it doubles when it is too small

Figures = dict[str, float | int | None]


def runs_by_itself(configuration: Configuration, scenario: Scenario | None = None) -> bool:
    """Return whether nothing happens in a run without commands but the drill's own motion.

    Faults of a scenario, a temperature, a tracking generator and the slow processes of drilling
    change a drill at their instants, and only a ``Simulation`` knows them.
    """
    actuator = configuration.actuator
    steady = not actuator.heating and actuator.generator != "tracking"
    return steady and not configuration.drilling.active and not (scenario and scenario.faults)


@dataclasses.dataclass(frozen=True)
class Member:
    """Result of one member."""

    figures: Figures  # of the whole run; empty if it failed
    # its energy account; None if it failed, or without accounts
    account: EnergyAccount | None = None
    failure: EngineError | None = None  # why it failed; None if it did not
    feed: FeedAccount | None = None  # its account of feed and mount; None without a feed
    rotation: RotorWork | None = None  # energies of its rotor; None without rotation


class _Room(threading.local):
    """Arrays that all calls of the kernel in a thread share."""

    def __init__(self) -> None:
        self.impacts = np.empty(_FIRST_IMPACTS, IMPACT)
        self.classes = np.zeros(CLASSES, np.int64)  # empty between two calls
        self.part = np.zeros(PART_ROOM)

    def grow(self) -> None:
        """Make room for twice as many impacts, and keep those that are there."""
        impacts = np.empty(2 * len(self.impacts), IMPACT)
        impacts[: len(self.impacts)] = self.impacts
        self.impacts = impacts


_room = _Room()


class QuietRuns:
    """Runs of one drill without commands, from time zero on, which differ in their phases."""

    def __init__(self, configuration: Configuration, phases: Sequence[float]) -> None:
        self._parameters = parameters = configuration.parameters
        drive = nominal_drive(configuration)
        actuator = Actuator(configuration.actuator, parameters.vibration_amplitude, drive)
        self._drill: Drill = derive(parameters)
        self._rpud: RpudConstants = rpud_constants(parameters, actuator.resonance)
        self._resonant = actuator.resonance is not None
        state = initial_state(parameters, 0.0, actuator.level > 0.0, actuator.resonance)
        self._states = state.repeat(len(phases))
        self._states["phase"] = [phase % 1.0 for phase in phases]
        if self._resonant:
            self._states["drive_phase"] = self._states["phase"]
        self._segments = np.zeros(len(phases), SEGMENT)
        self._impacts = np.zeros(len(phases), IMPACT)
        self._statuses = np.full(len(phases), DONE)
        self._quantiles = np.full(len(phases), -1)
        self._drawn = [0.0] * len(phases)
        self._progress = Progress(configuration.rock, parameters.tool_length)
        self._begun = False
        self._time = 0

    @property
    def time(self) -> int:
        """Simulation time [ns]."""
        return self._time

    @property
    def depth(self) -> float:
        """Depth of the hole of a single run that is advanced [m]; NaN without a rock model."""
        return self._progress.depth

    def run(self, end: int, whole: bool) -> list[Member]:
        """Run all from time zero to an end [ns], and return their results.

        Args:
            whole: whether the energy accounts are wanted.
        """
        tallies = empty_tallies(len(self._states))
        self._advance(end, tallies, _room.classes, (True, True, True, True, whole))
        return [self._result(tallies, number, whole) for number in range(len(tallies))]

    def advance_to(
        self, time: int, statistics: Statistics | None = None, whole: bool = True
    ) -> np.ndarray:
        """Advance a single run to a time [ns], and return its impacts since the last call.

        Args:
            statistics: to add to what happens; None for none.
            whole: whether the energy account is wanted; the figures need only a part of it.

        Returns:
            ``IMPACT`` records, which the next call of any run in this thread overwrites.
        """
        [_] = self._states
        begin = self._time
        counts = begin == 0
        if statistics is None:
            tallies, classes = empty_tallies(1), _room.classes
        else:
            tallies, classes = statistics.sums
            counts = counts and not statistics.begun
        options = (not self._begun, False, statistics is not None, counts, whole)
        count = self._advance(time, tallies, classes, options)
        if (error := self._error(0)) is not None:
            raise error
        electrical = self._electrical(0)
        if statistics is not None:
            statistics.note_part(begin, time, electrical)
        found = _room.impacts[:count]
        if self._drill.in_rock:
            self._progress.add(found)
        return found

    def _advance(
        self,
        time: int,
        tallies: np.ndarray,
        classes: np.ndarray,
        options: tuple[bool, bool, bool, bool, bool],
    ) -> int:
        """Advance all runs; return how many impacts the last one had."""
        members = (
            self._states,
            self._segments,
            self._impacts,
            tallies,
            self._statuses,
            self._quantiles,
        )
        begin, end = split_fraction(self._time), split_fraction(time)
        progress = np.array([0, -1, 0])
        while not advance_members(
            self._drill,
            self._rpud,
            members,
            *begin,
            *end,
            options,
            (_room.impacts, classes, _room.part),
            progress,
        ):
            _room.grow()
        self._begun = True
        self._time = time
        return int(progress[2])

    def _result(self, tallies: np.ndarray, number: int, whole: bool) -> Member:
        if (error := self._error(number)) is not None:
            return Member({}, failure=error)
        quantile = int(self._quantiles[number])
        figures = figures_of(tallies[number], self._time / SECOND, quantile)
        if not whole:
            return Member(figures)
        return Member(figures, EnergyAccount.from_tally(tallies[number], self._electrical(number)))

    def _error(self, number: int) -> EngineError | None:
        status = int(self._statuses[number])
        if status == DONE:
            return None
        return failure(status, self._parameters, self._drill, self._states[number : number + 1])

    def _electrical(self, number: int) -> float:
        """Return the electrical energy since the last call [J]; NaN without a resonance."""
        if not self._resonant:
            return math.nan
        state = self._states[number]
        seconds, fraction = split_fraction(self._time)
        ahead = float(seconds - state["seconds"]) + (fraction - state["fraction"])
        drawn = float(account(state, self._segments[number], ahead).drawn)
        before, self._drawn[number] = self._drawn[number], drawn
        return drawn - before
