"""Engine: the motion of the drill from event to event, under changing commands and constants."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import ExpectedError
from rpud_sim.model.compile import machine_code, reader_of
from rpud_sim.model.drill import STATE, DrillConstants, derive, seating
from rpud_sim.model.events import (
    DONE,
    FULL,
    IMPACTS_OF_EVENT,
    OVERLOADED,
    STALLED,
    advance,
    interrupt,
    start,
)
from rpud_sim.model.parameters import QUANTITIES, Parameters
from rpud_sim.model.resonator import Resonance, ResonatorEnergy
from rpud_sim.model.segment import IMPACT, SEGMENT, join_records, motion_at
from rpud_sim.model.segment_vibration import account
from rpud_sim.model.tolerances import EVENT_BUDGET, LONGEST_STANDSTILL

# How many values a message names, and how far from the default a value is unusual [factor].
_MOST_VALUES = 4
_USUAL = 30.0

# Segments that there is space for at first, and at most after a drain. The space doubles when it is
# too small.
_LEAST_ROOM = 256
_MOST_ROOM = 65536

_time = reader_of(STATE, "seconds", "fraction")
_amplitude = reader_of(STATE, "amplitude")


# Fields of the state that a ``Resonance`` sets.
_OF_RESONANCE = (
    *("decay_time", "resistance", "amplitude_per_volt"),
    *("voltage", "drive_frequency", "resonance_frequency"),
)


class EngineError(ExpectedError, RuntimeError):
    """Failure of the engine; the text is one line with the time and the likely parameters."""


def initial_state(
    parameters: Parameters, initial_phase: float, drive: bool, resonance: Resonance | None
) -> np.ndarray:
    state = np.zeros(1, STATE)
    amplitude = parameters.vibration_amplitude if drive else 0.0
    state["phase"] = initial_phase % 1.0
    state["frequency"] = parameters.vibration_frequency
    state["amplitude"] = amplitude
    state["target_amplitude"] = amplitude
    state["weight_on_bit"] = parameters.weight_on_bit
    if resonance is not None:
        state["resonant"] = 1
        state["amplitude"] = state["target_amplitude"] = 0.0
        state["drive_phase"] = state["phase"]
        for name, value in zip(_OF_RESONANCE, resonance, strict=True):
            state[name] = value
        state["modal_mass"] = resonance.mass
    return state


def failure(
    status: int, parameters: Parameters, drill: DrillConstants, states: np.ndarray
) -> EngineError:
    """Return the error of an advance that failed, with the values furthest from their defaults."""
    reason = {
        STALLED: f"more than {LONGEST_STANDSTILL} events at one instant",
        OVERLOADED: f"events exceed their budget of {EVENT_BUDGET:g} in a simulated second",
    }.get(status, "the motion cannot be computed in double precision")
    state = states[0]
    values = {name: float(getattr(parameters, name)) for name in QUANTITIES}
    values["load_spring_rate"], values["gravity"] = drill.load_spring_rate, drill.gravity
    values["weight_on_bit"] = float(state["weight_on_bit"])
    values["vibration_amplitude"] = float(state["amplitude"])
    values["vibration_frequency"] = float(state["frequency"])
    ranked = []
    for name, value in values.items():
        usual = getattr(Parameters, name)
        if value > 0.0:  # zero is usual: a drill without gravity, weight or drive
            text = f"{name} = {value:.4g} {QUANTITIES[name].unit}".rstrip()
            ranked.append((max(value / usual, usual / value), f"{text} (default: {usual:g})"))
    ranked.sort(reverse=True)
    far = [text for factor, text in ranked if factor > _USUAL] or [ranked[0][1]]
    time = float(state["seconds"] + state["fraction"])
    return EngineError(f"{reason} at {time:.6g} s, with {', '.join(far[:_MOST_VALUES])}")


def _cleared(count: int, dtype: np.dtype[Any]) -> np.ndarray:
    # What np.zeros returns is cleared by the system page by page, when the engine comes there.
    room = np.empty(count, dtype)
    room.view(np.uint8)[:] = 0
    return room


# Bytes between the fields of a segment, which no kernel writes.
_OFFSETS: Any = SEGMENT.fields
_PADDING = slice(_OFFSETS["event"][1] + 1, _OFFSETS["vibration_phase"][1])


def _unpadded(count: int) -> np.ndarray:
    """Return space for segments whose padding alone is cleared.

    To clear it all takes a tenth of the time to fill it.
    """
    room = np.empty(count, SEGMENT)
    room.view(np.uint8).reshape(count, SEGMENT.itemsize)[:, _PADDING] = 0
    return room


def _enlarged(records: np.ndarray, count: int) -> np.ndarray:
    room = _cleared(count, records.dtype)
    room[: len(records)].view(np.uint8)[:] = records.view(np.uint8)
    return room


class Buffers(threading.local):
    """Segments and impacts since a drain; in each thread engines may share them in turn."""

    def __init__(self) -> None:
        self.segments = _cleared(_LEAST_ROOM, SEGMENT)
        self.impacts = _cleared(_LEAST_ROOM, IMPACT)


class Engine:
    """Motion of the drill from time zero on, event by event.

    The vibration starts at a phase [cycles], from rest if it is a resonance. Without a drive its
    amplitude is zero. With shared ``buffers`` nothing is allocated, and what a drain returns is
    valid until the next advance.
    """

    def __init__(
        self,
        parameters: Parameters,
        initial_phase: float = 0.0,
        drive: bool = True,
        resonance: Resonance | None = None,
        buffers: Buffers | None = None,
    ) -> None:
        self._parameters = parameters
        self._drill = self._target = derive(parameters)
        # Times and constants of the steps to come.
        self._seating: deque[tuple[tuple[int, float], DrillConstants]] = deque()
        self._state = initial_state(parameters, initial_phase, drive, resonance)
        self._open_segment = np.zeros(1, SEGMENT)
        self._open_impact = np.zeros(1, IMPACT)
        self._shared = buffers
        buffers = buffers or Buffers()
        self._segment_room, self._impact_room = buffers.segments, buffers.impacts
        self._written = self._struck = 0  # segments and impacts since the last drain
        # A time to advance to, and what is finished there
        self._goal = (np.zeros(1, np.int64), np.zeros(1), np.zeros((1, 2), np.int64))
        self._reached: tuple[int, float] | None = None  # time that an advance has reached
        rooms = (self._segment_room, self._impact_room)
        seconds, fractions, counts = self._goal
        self._advance_code = machine_code(
            advance, *self._records, seconds, fractions, *rooms, counts, (0, 0, 0)
        )
        self._interrupt_code = machine_code(interrupt, *self._records, 0.0, *rooms, (0.0,) * 6)
        self._struck = start(*self._records, self._impact_room)

    @property
    def _records(self) -> tuple[DrillConstants, np.ndarray, np.ndarray, np.ndarray]:
        return self._drill, self._state, self._open_segment, self._open_impact

    @property
    def open_segment(self) -> np.ndarray:
        """The segment in progress, shape (1,); it changes with the next advance."""
        return self._open_segment

    @property
    def impact_count(self) -> int:
        """Impacts on the drill tool that have begun."""
        return int(self._state["impacts"][0])

    @property
    def amplitude(self) -> float:
        amplitude: float = _amplitude(self._state)[0]
        return amplitude

    @property
    def seats(self) -> bool:
        """Whether the rock is taking hold of the drill tool."""
        return bool(self._seating)

    def impacts_from(self, number: int) -> np.ndarray:
        """Return the impacts finished since the last drain, from a number on, until it advances."""
        return self._impact_room[number : self._struck]

    def account(self, seconds: int, fraction: float) -> ResonatorEnergy:
        """Return envelope and energies of a resonance, else zeros, not before the last event."""
        if not self._state["resonant"][0]:
            return ResonatorEnergy(0j, 0.0, 0.0, 0.0, 0.0, 0.0)
        return account(self._state[0], self._open_segment[0], self.ahead(seconds, fraction))

    def ahead(self, seconds: int, fraction: float) -> float:
        start_seconds, start_fraction = _time(self._state)
        return float(seconds - start_seconds) + (fraction - start_fraction)

    def advance(self, seconds: int, fraction: float) -> None:
        """Advance to a time, whole seconds and a fraction from 0 to 1; not back.

        ``EngineError``: the events exceed their budget, or the motion is no longer finite.
        """
        if self._reached == (seconds, fraction):
            return
        while self._seating and self._seating[0][0] <= (seconds, fraction):
            time, drill = self._seating.popleft()
            self._advance(*time)
            self._interrupt(*time, drill, self._commands())
        self._advance(seconds, fraction)
        self._reached = (seconds, fraction)

    def advance_through(self, seconds: np.ndarray, fractions: np.ndarray) -> np.ndarray | None:
        """Advance to times one after the other, in one call of a kernel.

        Return how many segments and impacts since the last drain were finished at each time, shape
        (times, 2). None if the engine cannot advance so and has not moved: ``advance`` shows why.
        """
        if self._seating and self._seating[0][0] <= (seconds[-1], fractions[-1]):
            return None
        records = [each.copy() for each in (self._state, self._open_segment, self._open_impact)]
        written, struck = self._written, self._struck
        counts = np.empty((len(seconds), 2), np.int64)
        try:
            self._fly(seconds, fractions, counts)
        except EngineError:
            self._state, self._open_segment, self._open_impact = records
            self._written, self._struck = written, struck
            return None
        self._reached = None
        return counts

    def change(
        self,
        seconds: int,
        fraction: float,
        drill: DrillConstants,
        commands: tuple[float, float, float],
        resonance_frequency: float = 0.0,
        passed: float = 0.0,
        touches: bool = False,
    ) -> None:
        """Advance to a time and continue from there with other commands, and with another drill.

        The commands are weight on bit [N], vibration amplitude [m] and frequency [Hz]; of a
        resonance weight on bit, voltage [V] and drive frequency. Positions, velocities and phase
        stay continuous; the amplitude changes at the next zero of the vibration. The rock takes
        hold of a free tool step by step (``seating``), unless it ``touches`` it and the actuator is
        behind. The origin of all displacements passes the bodies by ``passed`` [m].
        """
        self.advance(seconds, fraction)
        if drill != self._target:
            self._target = drill
            self._seating.clear()
            for delay, step in seating(self._drill, drill):
                whole, rest = divmod(fraction + delay, 1.0)
                self._seating.append(((seconds + int(whole), rest), step))
            self._drill = self._seating.popleft()[1]
        grips = False
        if self._seating and touches and not drill.jammed:
            motion = motion_at(self._open_segment[0], self.ahead(seconds, fraction))
            grips = motion[2] - passed <= 0.0
        if grips:
            self._seating.clear()
            self._drill = drill
        new = (*commands, resonance_frequency, passed, float(grips))
        self._interrupt(seconds, fraction, self._drill, new)

    def drain(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the segments finished since the last call with the open one, and the impacts."""
        room, count = self._segment_room, self._written + 1
        # Bytes, because NumPy copies structures field by field.
        room[count - 1 : count].view(np.uint8)[:] = self._open_segment.view(np.uint8)
        struck, self._written, self._struck = self._impact_room[: self._struck], 0, 0
        if self._shared:
            # As joined ones are: a kernel is compiled again for an array that may be written.
            covering = room[:count]
            covering.flags.writeable = struck.flags.writeable = False
            return covering, struck
        impacts = join_records([struck], IMPACT)
        given = 2 * count > len(room)
        if given:  # the space itself: to copy it would take longer than to allocate the next one
            covering = room[:count]
            covering.flags.writeable = False
        else:
            covering = join_records([room[:count]], SEGMENT)
        if given or len(room) > _MOST_ROOM:
            self._segment_room = _unpadded(min(len(room), _MOST_ROOM))
        return covering, impacts

    def _commands(self) -> tuple[float, ...]:
        state = self._state[0]
        names = ("target_amplitude", "frequency")
        if state["resonant"]:
            names = ("voltage", "drive_frequency")
        new = [float(state[name]) for name in ("weight_on_bit", *names, "resonance_frequency")]
        return (*new, 0.0, 0.0)

    def _advance(self, seconds: int, fraction: float) -> None:
        whole, rest, counts = self._goal
        whole[0], rest[0] = seconds, fraction
        self._fly(whole, rest, counts)

    def _fly(self, seconds: np.ndarray, fractions: np.ndarray, counts: np.ndarray) -> None:
        """Advance to times one after the other; counts get what is finished at each of them."""
        status, reached = FULL, 0
        while status == FULL:
            rooms = (self._segment_room, self._impact_room)
            begun = (reached, self._written, self._struck)
            status, reached, self._written, self._struck = self._advance_code(
                *self._records, seconds, fractions, *rooms, counts, begun
            )
            if status == FULL:
                self._make_room(2 * len(self._segment_room))
        if status != DONE:
            raise failure(status, self._parameters, self._drill, self._state)

    def _interrupt(
        self, seconds: int, fraction: float, drill: DrillConstants, commands: tuple[float, ...]
    ) -> None:
        self._drill = drill
        self._reached = None
        # Besides what it ends, an open segment follows.
        free = len(self._segment_room) - self._written, len(self._impact_room) - self._struck
        if min(free) < IMPACTS_OF_EVENT + 1:
            self._make_room(2 * len(self._segment_room))
        segment = self._segment_room[self._written : self._written + 1]
        rooms = (segment, self._impact_room[self._struck :])
        time = self.ahead(seconds, fraction)
        self._struck += self._interrupt_code(*self._records, time, *rooms, commands)
        self._written += 1

    def _make_room(self, count: int) -> None:
        """Take a larger space for segments and impacts, with those that are there."""
        self._segment_room = _enlarged(self._segment_room[: self._written], count)
        self._impact_room = _enlarged(self._impact_room[: self._struck], count)
        if self._shared:
            self._shared.segments, self._shared.impacts = self._segment_room, self._impact_room
