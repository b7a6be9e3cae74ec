"""Engine: the motion of the drill from event to event, under changing commands and constants."""

from __future__ import annotations

from collections import deque
from typing import NoReturn

import numpy as np

from rpud_sim.model.drill import STATE, Drill, derive
from rpud_sim.model.events import FULL, OVERLOADED, STALLED, advance, interrupt, start
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.seating import seating
from rpud_sim.model.segment import IMPACT, SEGMENT, join_records
from rpud_sim.model.tolerances import EVENT_BUDGET, LONGEST_STANDSTILL
from rpud_sim.model.unusual import unusual_values

# Records that one call of the kernel can return; it is called again when they are full. With larger
# arrays, every call gets fresh memory from the system, and short blocks take a fifth longer.
_CAPACITY = 256


class EngineError(RuntimeError):
    """Failure of the engine; the text is one line with the time and the likely parameters."""


class Engine:
    """Motion of the drill from time zero on, event by event.

    Args:
        parameters: of the drill.
        initial_phase: of the vibration [cycles].
        drive: whether the actuator vibrates from the start.
    """

    def __init__(
        self, parameters: Parameters, initial_phase: float = 0.0, drive: bool = True
    ) -> None:
        self._parameters = parameters
        self._drill = derive(parameters)
        self._target = self._drill
        # Times and constants of the steps to come.
        self._seating: deque[tuple[tuple[int, float], Drill]] = deque()
        self._state = np.zeros(1, STATE)
        self._open_segment = np.zeros(1, SEGMENT)
        self._open_impact = np.zeros(1, IMPACT)
        self._segments: list[np.ndarray] = []
        self._impacts: list[np.ndarray] = []
        amplitude = parameters.vibration_amplitude if drive else 0.0
        self._state["phase"] = initial_phase % 1.0
        self._state["frequency"] = parameters.vibration_frequency
        self._state["amplitude"] = amplitude
        self._state["target_amplitude"] = amplitude
        self._state["weight_on_bit"] = parameters.weight_on_bit
        impacts = np.zeros(2, IMPACT)
        count = start(self._drill, self._state, self._open_segment, self._open_impact, impacts)
        self._impacts.append(impacts[:count])

    @property
    def impact_count(self) -> int:
        """Impacts on the drill tool that have begun."""
        return int(self._state["impacts"][0])

    def advance(self, seconds: int, fraction: float) -> None:
        """Advance to a time, whole seconds and a fraction from 0 to 1; not back.

        Raises:
            EngineError: if events follow each other without time passing, or exceed their budget.
        """
        while self._seating and self._seating[0][0] <= (seconds, fraction):
            time, drill = self._seating.popleft()
            self._advance(*time)
            state = self._state[0]
            commands = (
                float(state["weight_on_bit"]),
                float(state["target_amplitude"]),
                float(state["frequency"]),
            )
            self._interrupt(*time, drill, commands)
        self._advance(seconds, fraction)

    def change(
        self, seconds: int, fraction: float, drill: Drill, commands: tuple[float, float, float]
    ) -> None:
        """Advance to a time and go on from there with other commands, and with another drill.

        Positions and velocities and the phase of the vibration stay continuous; the amplitude
        changes when the vibration next passes through zero. The rock takes hold of a free drill
        tool step by step (see seating.py).

        Args:
            seconds: whole seconds of the time, not before the last one.
            fraction: the rest of it [s].
            drill: the constants from there on.
            commands: weight on bit [N], vibration amplitude [m] and vibration frequency [Hz].

        Raises:
            EngineError: if events follow each other without time passing, or exceed their budget.
        """
        self.advance(seconds, fraction)
        if drill != self._target:
            self._target = drill
            self._seating.clear()
            for delay, step in seating(self._drill, drill):
                whole, rest = divmod(fraction + delay, 1.0)
                self._seating.append(((seconds + int(whole), rest), step))
            self._drill = self._seating.popleft()[1]
        self._interrupt(seconds, fraction, self._drill, commands)

    def _advance(self, seconds: int, fraction: float) -> None:
        status = FULL
        while status == FULL:
            segments = np.empty(_CAPACITY, SEGMENT)
            impacts = np.empty(2 * _CAPACITY + 2, IMPACT)
            status, written, count = advance(
                self._drill,
                self._state,
                self._open_segment,
                self._open_impact,
                seconds,
                fraction,
                segments,
                impacts,
            )
            self._segments.append(segments[:written])
            self._impacts.append(impacts[:count])
        if status == STALLED:
            self._fail(f"more than {LONGEST_STANDSTILL} events at one instant")
        if status == OVERLOADED:
            self._fail(f"events exceed their budget of {EVENT_BUDGET:g} in a simulated second")

    def _fail(self, reason: str) -> NoReturn:
        state = self._state[0]
        time = float(state["seconds"] + state["fraction"])
        unusual = ", ".join(unusual_values(self._parameters, self._drill, state))
        raise EngineError(f"{reason} at {time:.6g} s, with {unusual}")

    def _interrupt(
        self, seconds: int, fraction: float, drill: Drill, commands: tuple[float, float, float]
    ) -> None:
        self._drill = drill
        state = self._state[0]
        time = float(seconds - state["seconds"]) + (fraction - state["fraction"])
        segments = np.empty(1, SEGMENT)
        impacts = np.empty(2, IMPACT)
        count = interrupt(
            drill,
            self._state,
            self._open_segment,
            self._open_impact,
            time,
            segments,
            impacts,
            commands,
        )
        self._segments.append(segments)
        self._impacts.append(impacts[:count])

    def drain(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the segments and the impacts finished since the last call, in order."""
        covering, impacts = self.drain_covering()
        return covering[:-1], impacts

    def drain_covering(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the same as ``drain``, with the open segment after the finished ones."""
        covering = join_records([*self._segments, self._open_segment], SEGMENT)
        impacts = join_records(self._impacts, IMPACT)
        self._segments.clear()
        self._impacts.clear()
        return covering, impacts
