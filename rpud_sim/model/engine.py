"""Engine: the motion of the drill from event to event, under changing commands and constants."""

from __future__ import annotations

import math
from collections import deque
from operator import itemgetter
from sys import getrefcount

import numpy as np

from rpud_sim.model.drill import STATE, Drill, derive, seating
from rpud_sim.model.events import (
    DONE,
    FULL,
    OVERLOADED,
    STALLED,
    advance,
    advance_through,
    interrupt,
    start,
)
from rpud_sim.model.parameters import QUANTITIES, Parameters
from rpud_sim.model.resonator import Account, Resonance, account
from rpud_sim.model.segment import IMPACT, SEGMENT, join_records, motion_at
from rpud_sim.model.tolerances import EVENT_BUDGET, LONGEST_STANDSTILL

# How many values a message names, and how far from the default a value is unusual [factor].
_MOST = 4
_USUAL = 30.0

_ALWAYS = (
    "rpud_mass",
    "free_mass",
    "load_spring_rate",
    "gravity",
    "weight_on_bit",
    "vibration_amplitude",
    "vibration_frequency",
)
_BEFORE_DRILLING = ("drill_tool_mass", "restoring_spring_rate")
_GIVEN = ("effective_tool_mass", "effective_tool_spring_rate")
_SECTIONS = (
    "elastic_modulus",
    "section_1_length",
    "section_1_area",
    "section_2_length",
    "section_2_area",
    "drill_tool_density",
)


def unusual_values(parameters: Parameters, drill: Drill, state: np.void) -> list[str]:
    """Return the values in force that are furthest from the default, furthest first.

    Returns:
        At least one text such as ``free_mass = 1e-09 kg (default: 0.005)``.
    """
    usual = Parameters()
    ranked = sorted(
        (
            (
                max(value / getattr(usual, name), getattr(usual, name) / value),
                f"{name} = {value:.4g} {QUANTITIES[name].unit} (default: {getattr(usual, name):g})",
            )
            for name, value in _acting(parameters, drill, state).items()
            if value > 0.0  # zero is usual: a drill without gravity, weight or drive
        ),
        reverse=True,
    )
    far = [text for factor, text in ranked if factor > _USUAL]
    return (far or [text for _, text in ranked[:1]])[:_MOST]


def _acting(parameters: Parameters, drill: Drill, state: np.void) -> dict[str, float]:
    """Return the values that act on the motion: those that may change from where they are."""
    tool: tuple[str, ...] = _BEFORE_DRILLING
    if drill.in_rock:
        tool = _GIVEN if parameters.contact_model == "given" else _SECTIONS
    values = {name: float(getattr(parameters, name)) for name in (*_ALWAYS, *tool)}
    values["load_spring_rate"] = drill.load_spring_rate
    values["gravity"] = drill.gravity
    values["weight_on_bit"] = float(state["weight_on_bit"])
    values["vibration_amplitude"] = float(state["amplitude"])
    values["vibration_frequency"] = float(state["frequency"])
    if not drill.in_rock:
        values["restoring_spring_rate"] = drill.tool_spring_rate
    return values


# Records that one call of the kernel can return, at least and at most; it is called again when they
# are full. There is room for as many as the last advance had, or as a drill usually has: a long one
# comes in one piece.
_CAPACITY = 256
_MOST_CAPACITY = 65536
_USUAL_RATE = 1500.0  # segments in a simulated second
_ROOMS = 3  # kept for the next advances: fresh memory from the system takes as long as the motion
_FREE = 3  # references to a room that is not in use
# What would be lost first if numbers overflowed: every other number of the state follows from them.
_FINITE = ("u_np", "v_np", "u_fm", "v_fm", "u_dt", "v_dt", "amplitude", "frequency", "owed")
# Of a state as a tuple: to look each one up by its name takes ten times as long.
_finite_values = itemgetter(*map((STATE.names or ()).index, _FINITE))


class EngineError(RuntimeError):
    """Failure of the engine; the text is one line with the time and the likely parameters."""


def initial_state(
    parameters: Parameters, initial_phase: float, drive: bool, resonance: Resonance | None
) -> np.ndarray:
    """Return the ``STATE`` before time zero, shape (1,); see ``Engine``."""
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
        state["decay_time"] = resonance.decay_time
        state["resistance"] = resonance.resistance
        state["amplitude_per_volt"] = resonance.amplitude_per_volt
        state["voltage"] = resonance.voltage
        state["drive_frequency"] = resonance.drive_frequency
        state["resonance_frequency"] = resonance.frequency
    return state


def is_finite(state: np.ndarray) -> bool:
    """Return whether the motion of one ``STATE`` is finite."""
    return all(map(math.isfinite, _finite_values(state[0].item())))


def failure(status: int, parameters: Parameters, drill: Drill, state: np.ndarray) -> EngineError:
    """Return the error of an advance that failed."""
    reason = {
        STALLED: f"more than {LONGEST_STANDSTILL} events at one instant",
        OVERLOADED: f"events exceed their budget of {EVENT_BUDGET:g} in a simulated second",
    }.get(status, "the motion cannot be computed in double precision")
    time = float(state[0]["seconds"] + state[0]["fraction"])
    unusual = ", ".join(unusual_values(parameters, drill, state[0]))
    return EngineError(f"{reason} at {time:.6g} s, with {unusual}")


class Engine:
    """Motion of the drill from time zero on, event by event.

    Args:
        initial_phase: of the vibration [cycles].
        resonance: of the vibration, which starts at rest; None if its amplitude is prescribed.
    """

    def __init__(
        self,
        parameters: Parameters,
        initial_phase: float = 0.0,
        drive: bool = True,
        resonance: Resonance | None = None,
    ) -> None:
        self._parameters = parameters
        self._drill = derive(parameters)
        self._target = self._drill
        # Times and constants of the steps to come.
        self._seating: deque[tuple[tuple[int, float], Drill]] = deque()
        self._state = initial_state(parameters, initial_phase, drive, resonance)
        self._open_segment = np.zeros(1, SEGMENT)
        self._open_impact = np.zeros(1, IMPACT)
        self._capacity = _CAPACITY
        self._room = np.empty(0, SEGMENT)  # of the last call of the kernel
        self._rooms: deque[np.ndarray] = deque(maxlen=_ROOMS)
        self._segments: list[np.ndarray] = []
        self._impacts: list[np.ndarray] = []
        impacts = np.zeros(2, IMPACT)
        count = start(self._drill, self._state, self._open_segment, self._open_impact, impacts)
        self._impacts.append(impacts[:count])

    @property
    def impact_count(self) -> int:
        """Impacts on the drill tool that have begun."""
        return int(self._state["impacts"][0])

    @property
    def amplitude(self) -> float:
        """Amplitude of the vibration at the last event [m]."""
        return float(self._state["amplitude"][0])

    def account(self, seconds: int, fraction: float) -> Account:
        """Return envelope and energies of the resonance at a time, not before the last event.

        They are zero if the vibration is prescribed.
        """
        if not self._state["resonant"][0]:
            return Account(0j, 0.0, 0.0, 0.0, 0.0, 0.0)
        return account(self._state[0], self._open_segment[0], self.ahead(seconds, fraction))

    def advance(self, seconds: int, fraction: float) -> None:
        """Advance to a time, whole seconds and a fraction from 0 to 1; not back.

        Raises:
            EngineError: if events follow each other without time passing or exceed their budget, or
                if the motion is no longer finite.
        """
        while self._seating and self._seating[0][0] <= (seconds, fraction):
            time, drill = self._seating.popleft()
            self._advance(*time)
            self._interrupt(*time, drill, self._commands())
        self._advance(seconds, fraction)

    def advance_through(
        self, seconds: np.ndarray, fractions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Advance to times one after the other, in one call of a kernel.

        Returns:
            The numbers of segments and of impacts since the last ``drain`` that were finished at
            each time. None if the engine cannot advance so: then it has not moved, and ``advance``
            shows why.
        """
        if self._seating and self._seating[0][0] <= (seconds[-1], fractions[-1]):
            return None
        kept = [each.copy() for each in (self._state, self._open_segment, self._open_impact)]
        drained = len(self._segments), len(self._impacts)
        finished = np.empty(len(seconds), np.int64)
        struck = np.empty(len(seconds), np.int64)
        segments_before = sum(map(len, self._segments))
        impacts_before = sum(map(len, self._impacts))
        reached = 0
        status = FULL
        while status == FULL:
            segments = np.empty(_MOST_CAPACITY, SEGMENT)
            impacts = np.empty(2 * _MOST_CAPACITY + 2, IMPACT)
            status, more, written, count = advance_through(
                self._drill,
                self._state,
                self._open_segment,
                self._open_impact,
                seconds[reached:],
                fractions[reached:],
                segments,
                impacts,
                finished[reached:],
                struck[reached:],
            )
            finished[reached : reached + more] += segments_before
            struck[reached : reached + more] += impacts_before
            reached += more
            segments_before += written
            impacts_before += count
            self._segments.append(segments[:written])
            self._impacts.append(impacts[:count])
        if status != DONE or not is_finite(self._state):
            self._state, self._open_segment, self._open_impact = kept
            del self._segments[drained[0] :], self._impacts[drained[1] :]
            return None
        return finished, struck

    def change(
        self,
        seconds: int,
        fraction: float,
        drill: Drill,
        commands: tuple[float, float, float],
        resonance_frequency: float = 0.0,
        passed: float = 0.0,
        touches: bool = False,
    ) -> None:
        """Advance to a time and go on from there with other commands, and with another drill.

        Positions and velocities and the phase of the vibration stay continuous; the amplitude
        changes when the vibration next passes through zero. The rock takes hold of a free drill
        tool step by step (see seating.py), unless it touches it.

        Args:
            commands: weight on bit [N], vibration amplitude [m] and vibration frequency [Hz]; of a
                resonance weight on bit [N], voltage [V] and drive frequency [Hz].
            resonance_frequency: of a resonance [Hz].
            passed: way by which the origin of all displacements passes the bodies [m].
            touches: whether the rock is at zero now, and stops a tool whose actuator is behind.
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

    @property
    def seats(self) -> bool:
        """Whether the rock is taking hold of the drill tool."""
        return bool(self._seating)

    def _commands(self) -> tuple[float, ...]:
        state = self._state[0]
        weight_on_bit = float(state["weight_on_bit"])
        if state["resonant"]:
            names = ("voltage", "drive_frequency", "resonance_frequency")
            voltage, drive_frequency, resonance_frequency = (float(state[name]) for name in names)
            return weight_on_bit, voltage, drive_frequency, resonance_frequency, 0.0, 0.0
        return (
            weight_on_bit,
            float(state["target_amplitude"]),
            float(state["frequency"]),
            0.0,
            0.0,
            0.0,
        )

    def ahead(self, seconds: int, fraction: float) -> float:
        """Time from the start of the open segment to a time [s]."""
        state = self._state[0]
        return float(seconds - state["seconds"]) + (fraction - state["fraction"])

    def _advance(self, seconds: int, fraction: float) -> None:
        status = FULL
        usual = int(_USUAL_RATE * self.ahead(seconds, fraction))
        capacity = min(max(self._capacity, usual), _MOST_CAPACITY)
        passed = 0
        while status == FULL:
            segments = self._room = self._free_room(capacity + 1)  # one for the open segment
            impacts = np.empty(2 * capacity + 2, IMPACT)
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
            passed += written
        self._capacity = min(max(passed + passed // 8, _CAPACITY), _MOST_CAPACITY)
        if status != DONE or not is_finite(self._state):
            raise failure(status, self._parameters, self._drill, self._state)

    def _free_room(self, count: int) -> np.ndarray:
        """Return room for segments, used again where no result refers to it any more."""
        for room in self._rooms:
            # Held by the deque, by this name and by the call.
            if count <= len(room) <= 2 * count and getrefcount(room) == _FREE:
                room.flags.writeable = True
                return room
        room = np.empty(count, SEGMENT)
        self._rooms.append(room)
        return room

    def _interrupt(
        self,
        seconds: int,
        fraction: float,
        drill: Drill,
        commands: tuple[float, ...],
    ) -> None:
        self._drill = drill
        segments = np.empty(1, SEGMENT)
        impacts = np.empty(2, IMPACT)
        count = interrupt(
            drill,
            self._state,
            self._open_segment,
            self._open_impact,
            self.ahead(seconds, fraction),
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
        covering = self._covering()
        impacts = join_records(self._impacts, IMPACT)
        self._segments.clear()
        self._impacts.clear()
        return covering, impacts

    def _covering(self) -> np.ndarray:
        """Return the segments since the last drain and the open one as one immutable array.

        One piece that uses most of its room is returned as it is, without a copy.
        """
        parts = self._segments
        room = self._room
        if len(parts) != 1 or parts[0].base is not room or 2 * len(parts[0]) < len(room):
            return join_records([*parts, self._open_segment], SEGMENT)
        count = len(parts[0])
        room.flags.writeable = False
        self._room = np.empty(0, SEGMENT)
        return room[: count + 1]
