"""The engine: from one event to the next, exactly.

    until the requested time:
        the open segment ends at its event (guards.py)
        close it, move the state there
        let the bodies collide and decide which contacts last (resets.py)
        write the closed form that follows (motion.py), find its event

What the engine finds does not depend on where a caller stops: a segment's event is computed once, from its start,
however many calls it takes to get there.
"""

from __future__ import annotations

import math

import numpy as np

from rpud_sim.model.compile import compiled
from rpud_sim.model.drill import STATE, derive
from rpud_sim.model.guards import (
    END_ACTUATOR_IMPACT,
    END_ACTUATOR_RELEASE,
    END_AMPLITUDE,
    END_DRILL_TOOL_IMPACT,
    END_DRILL_TOOL_RELEASE,
    END_DRILL_TOOL_REST,
    END_LIMIT,
)
from rpud_sim.model.impact import follow_impact, open_impact
from rpud_sim.model.motion import begin_segment
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.resets import close_gaps, exchange_momentum, join_held_bodies, lasting_contact
from rpud_sim.model.search import next_event
from rpud_sim.model.segment import (
    CONTACT_ACTUATOR,
    CONTACT_DRILL_TOOL,
    EVENT_ACTUATOR_IMPACT,
    EVENT_COMMAND,
    EVENT_DRILL_TOOL_IMPACT,
    EVENT_LIMIT,
    EVENT_RELEASE,
    IMPACT,
    SEGMENT,
    join,
    motion_at,
)
from rpud_sim.model.tolerances import (
    LONGEST_SEGMENT,
    LONGEST_STANDSTILL,
    SAME_VELOCITY,
    SHORTEST_SEGMENT,
)
from rpud_sim.model.vibration import advance_phase, harmonic_vibration

# Room for the results of one call of the kernel; it is called again when they are full.
_CAPACITY = 4096

DONE = 0
FULL = 1
STALLED = 2


class EngineError(RuntimeError):
    """The engine cannot go on; its text says when and in which state."""


@compiled
def carry_over(time):
    """Whole seconds in a fraction, and what is left of it."""
    whole = math.floor(time)
    return int(whole), time - whole


@compiled
def move_state(state, segment, time):
    """Move the state to a time after the start of its segment."""
    u_np, v_np, _, _, u_fm, v_fm, u_dt, v_dt = motion_at(segment, time)
    state.u_np, state.v_np = u_np, v_np
    state.u_fm, state.v_fm = u_fm, v_fm
    state.u_dt, state.v_dt = u_dt, v_dt
    seconds, fraction = carry_over(state.fraction + time)
    state.seconds += seconds
    state.fraction = fraction
    state.phase = advance_phase(state.phase, state.frequency, time)


@compiled
def settle(drill, state, impact, impacts, count, met, opened, event):
    """Resolve what happens at the state's instant.

    Args:
        drill: the constants.
        state: the moving state.
        impact: the record in progress.
        impacts: room for finished impacts.
        count: how many it holds.
        met: CONTACT_* bits of pairs whose approach ends here.
        opened: CONTACT_* bits of contacts that end here for want of force.
        event: EVENT_* bits of what is already known to happen.

    Returns:
        The number of finished impacts.
    """
    v_np = state.v_np
    closed = close_gaps(state, met)
    collisions = exchange_momentum(drill, state, closed)
    struck = collisions.actuator_struck or collisions.drill_tool_struck
    if struck:
        opened = 0
    state.contact = lasting_contact(drill, state, closed, opened, collisions.drill_tool_struck)
    in_contact = state.contact & CONTACT_DRILL_TOOL
    join_held_bodies(state)
    if collisions.actuator_struck or abs(state.v_np - v_np) > SAME_VELOCITY:
        event |= EVENT_ACTUATOR_IMPACT
    if collisions.drill_tool_struck:
        event |= EVENT_DRILL_TOOL_IMPACT
    if state.impact_open and (collisions.drill_tool_struck or not in_contact):
        impacts[count] = impact
        count += 1
        state.impact_open = 0
    if collisions.drill_tool_struck:
        open_impact(drill, state, impact, collisions)
        if not state.impact_open:
            impacts[count] = impact
            count += 1
    if drill.in_rock:
        state.tool_at_rest = not in_contact and state.u_dt <= 0.0
        if state.tool_at_rest:
            state.u_dt = 0.0
            state.v_dt = 0.0
    state.event = event
    return count


@compiled
def open_segment(drill, state, segment):
    """Write the segment that follows from the state, with its event and duration."""
    begin_segment(drill, state, segment)
    end, duration = next_event(drill, state, segment)
    segment.duration = duration
    state.next_event = end
    state.standstill = state.standstill + 1 if duration <= SHORTEST_SEGMENT else 0


@compiled
def pass_event(drill, state, segment, impact, impacts, count):
    """Go through the event that ends the open segment; returns the number of finished impacts."""
    end = state.next_event
    if state.impact_open:
        follow_impact(drill, segment, impact, segment.duration)
    move_state(state, segment, segment.duration)
    if end == END_LIMIT:
        state.event = EVENT_LIMIT
        if state.impact_open and impact.contact_duration >= LONGEST_SEGMENT:
            impacts[count] = impact
            count += 1
            state.impact_open = 0
        open_segment(drill, state, segment)
        return count
    event = 0
    met = 0
    opened = 0
    if end == END_ACTUATOR_IMPACT:
        met = CONTACT_ACTUATOR
    elif end == END_DRILL_TOOL_IMPACT:
        met = CONTACT_DRILL_TOOL
    elif end == END_AMPLITUDE:
        state.amplitude = state.target_amplitude
        # The sine is exactly zero here, so that the tip does not jump.
        state.phase = 0.5 if 0.25 < state.phase < 0.75 else 0.0
        event = EVENT_COMMAND
    elif end == END_ACTUATOR_RELEASE:
        opened = CONTACT_ACTUATOR
        event = EVENT_RELEASE
    elif end == END_DRILL_TOOL_RELEASE:
        opened = CONTACT_DRILL_TOOL
        event = EVENT_RELEASE
    elif end == END_DRILL_TOOL_REST:
        state.u_dt = 0.0
        state.v_dt = 0.0
        event = EVENT_RELEASE
    count = settle(drill, state, impact, impacts, count, met, opened, event)
    open_segment(drill, state, segment)
    return count


@compiled
def advance(drill, states, open_segments, open_impacts, seconds, fraction, segments, impacts):
    """Advance until the open segment reaches beyond a time, or the room for results is used up.

    Args:
        drill: the constants.
        states: one ``STATE``.
        open_segments: the one ``SEGMENT`` in progress.
        open_impacts: the one ``IMPACT`` in progress.
        seconds: whole seconds of the time.
        fraction: the rest of it [s].
        segments: room for finished segments.
        impacts: room for finished impacts, at least two more than segments.

    Returns:
        DONE, FULL or STALLED, and the numbers of finished segments and impacts.
    """
    state = states[0]
    segment = open_segments[0]
    impact = open_impacts[0]
    written = 0
    count = 0
    while True:
        ahead = float(seconds - state.seconds) + (fraction - state.fraction)
        if segment.duration > ahead:
            return DONE, written, count
        if written == len(segments):
            return FULL, written, count
        if state.standstill > LONGEST_STANDSTILL:
            return STALLED, written, count
        segments[written] = segment
        written += 1
        count = pass_event(drill, state, segment, impact, impacts, count)


@compiled
def interrupt(drill, states, open_segments, open_impacts, time, segments, impacts, new):
    """End the open segment early, at a time after its start, and go on with new commands.

    Args:
        drill: the constants.
        states: one ``STATE``.
        open_segments: the one ``SEGMENT`` in progress.
        open_impacts: the one ``IMPACT`` in progress.
        time: after the segment's start [s].
        segments: room for one finished segment.
        impacts: room for two finished impacts.
        new: weight on bit [N], vibration amplitude [m] and frequency [Hz] from here on.

    Returns:
        The number of finished impacts.
    """
    state = states[0]
    segment = open_segments[0]
    impact = open_impacts[0]
    if state.impact_open:
        follow_impact(drill, segment, impact, time)
    move_state(state, segment, time)
    segments[0] = segment
    segments[0].duration = time
    weight_on_bit, amplitude, frequency = new
    state.weight_on_bit = weight_on_bit
    state.target_amplitude = amplitude
    state.frequency = frequency
    count = settle(drill, state, impact, impacts, 0, 0, 0, EVENT_COMMAND)
    open_segment(drill, state, segment)
    return count


@compiled
def start(drill, states, open_segments, open_impacts, impacts):
    """Begin with every gap closed and every body at rest; returns the number of finished impacts."""
    state = states[0]
    state.u_np = -state.amplitude * math.sin(2.0 * math.pi * state.phase)
    count = settle(
        drill, state, open_impacts[0], impacts, 0, 0, 0, 0
    )
    open_segment(drill, state, open_segments[0])
    return count


class Engine:
    """The drill's motion from time zero on, event by event.

    Args:
        parameters: of the drill.
        initial_phase: of the vibration [cycles].
        drive: whether the actuator vibrates from the start.
    """

    def __init__(
        self, parameters: Parameters, initial_phase: float = 0.0, drive: bool = True
    ) -> None:
        self._drill = derive(parameters)
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
        count = start(
            self._drill, self._state, self._open_segment, self._open_impact, impacts
        )
        self._impacts.append(impacts[:count])

    @property
    def open_segment(self) -> np.ndarray:
        """The segment in progress, one ``SEGMENT``: valid until its end unless a command comes before."""
        return self._open_segment.copy()

    @property
    def impact_count(self) -> int:
        """Impacts on the drill tool that have begun."""
        return int(self._state["impacts"][0])

    def advance(self, seconds: int, fraction: float) -> None:
        """Advance to a time, whole seconds and a fraction from 0 to 1; an earlier time does nothing.

        Raises:
            EngineError: if events follow each other without time passing.
        """
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
            values = dict(zip(STATE.names or (), self._state[0].tolist(), strict=True))
            raise EngineError(f"more than {LONGEST_STANDSTILL} events at one instant: {values}")

    def command(self, seconds: int, fraction: float, new: tuple[float, float, float]) -> None:
        """Advance to a time and go on with other commands from there.

        Position and velocity of the nodal plane and the phase of the vibration stay continuous; the amplitude
        changes when the vibration next passes through zero.

        Args:
            seconds: whole seconds of the time, not before the last one.
            fraction: the rest of it [s].
            new: weight on bit [N], vibration amplitude [m] and vibration frequency [Hz].
        """
        self.advance(seconds, fraction)
        state = self._state[0]
        time = float(seconds - state["seconds"]) + (fraction - state["fraction"])
        segments = np.empty(1, SEGMENT)
        impacts = np.empty(2, IMPACT)
        count = interrupt(
            self._drill,
            self._state,
            self._open_segment,
            self._open_impact,
            time,
            segments,
            impacts,
            new,
        )
        self._segments.append(segments)
        self._impacts.append(impacts[:count])

    def take(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the segments and the impacts finished since the last call, in order."""
        segments = join(self._segments, SEGMENT)
        impacts = join(self._impacts, IMPACT)
        self._segments.clear()
        self._impacts.clear()
        return segments, impacts
