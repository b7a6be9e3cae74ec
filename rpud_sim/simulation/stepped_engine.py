"""Engine of a drill with slow processes, which stops and changes in each millisecond."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numba import typeof

from rpud_sim.model.drill import STATE, Drill
from rpud_sim.model.engine import Engine, failure
from rpud_sim.model.events import DONE, FULL, advance, interrupt
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.resonator import Resonance
from rpud_sim.model.segment import IMPACT, SEGMENT, join_records

_FIRST_ROOM = 256  # segments; it doubles when it is too small
_MOST_ROOM = 4096  # segments for which the room is kept after a long block

# NumPy builds an object for the record and one for each field, which takes many times as long.
_CODES = {"f8": "d", "i8": "q"}


def reader_of(dtype: np.dtype, *names: str) -> Callable[[np.ndarray], tuple[Any, ...]]:
    """Return a function that reads fields of the first record of an array.

    Args:
        names: of fields of 64 bits, in the order in which the dtype has them.
    """
    layout, end = "=", 0
    fields: Mapping[str, Any] = dtype.fields or {}
    for name in names:
        kind, offset = fields[name][:2]
        layout += f"{offset - end}x{_CODES[kind.str[1:]]}"
        end = offset + kind.itemsize
    read: Any = struct.Struct(layout).unpack_from  # takes arrays as buffers
    return read


_FINITE = ("amplitude", "u_np", "v_np", "u_fm", "v_fm", "u_dt", "v_dt", "owed")
_finite_values = reader_of(STATE, "frequency", *_FINITE)
_time = reader_of(STATE, "seconds", "fraction")
_amplitude = reader_of(STATE, "amplitude")


def machine_code(kernel: Any, *examples: object) -> Callable[..., Any]:
    """Return a kernel as it is compiled for the types of examples; other types must not follow.

    A call of the kernel itself looks at the type of each argument, which takes several times as
    long as the motion of a millisecond.
    """
    if not hasattr(kernel, "compile"):  # NUMBA_DISABLE_JIT
        code: Callable[..., Any] = kernel
    else:
        code = kernel.compile(tuple(map(typeof, examples)))
    return code


class SteppedEngine(Engine):
    """Engine for many short advances with a change after each: the same bits at less cost.

    All records of a block are written one after the other into the same room. ``Engine`` makes
    fresh arrays in each call, which take longer than the motion of a millisecond.
    """

    def __init__(
        self,
        parameters: Parameters,
        initial_phase: float = 0.0,
        drive: bool = True,
        resonance: Resonance | None = None,
    ) -> None:
        super().__init__(parameters, initial_phase, drive, resonance)
        self._make_room(_FIRST_ROOM)
        self._written = 0
        self._reached: tuple[int, float] | None = None
        began = join_records(self._impacts, IMPACT)
        self._struck = len(began)
        self._impact_room[: self._struck] = began
        self._impacts.clear()
        records = (self._drill, self._state, self._open_segment, self._open_impact)
        rooms = (self._segment_room, self._impact_room)
        self._advance_code = machine_code(advance, *records, 0, 0.0, *rooms)
        self._interrupt_code = machine_code(interrupt, *records, 0.0, *rooms, (0.0,) * 6)

    @property
    def open_segment(self) -> np.ndarray:
        """The segment in progress, shape (1,); it changes with the next advance."""
        return self._open_segment

    @property
    def amplitude(self) -> float:
        """Amplitude of the vibration at the last event [m]."""
        amplitude: float = _amplitude(self._state)[0]
        return amplitude

    def impacts_from(self, number: int) -> np.ndarray:
        """Return the impacts that finished since the last drain, from a number on.

        They are valid until the next advance.
        """
        return self._impact_room[number : self._struck]

    def advance(self, seconds: int, fraction: float) -> None:
        """Advance as ``Engine`` does; nothing happens at a time that it has reached already."""
        if self._reached != (seconds, fraction):
            super().advance(seconds, fraction)
            self._reached = (seconds, fraction)

    def advance_through(
        self, seconds: np.ndarray, fractions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return None: the steps between the times must be taken one by one."""
        return None

    def drain_covering(self) -> tuple[np.ndarray, np.ndarray]:
        """Return segments and impacts as ``Engine`` does."""
        covering = join_records([self._segment_room[: self._written], self._open_segment], SEGMENT)
        impacts = join_records([self._impact_room[: self._struck]], IMPACT)
        self._written = self._struck = 0
        if len(self._segment_room) > _MOST_ROOM:
            self._make_room(_FIRST_ROOM)
        return covering, impacts

    def _advance(self, seconds: int, fraction: float) -> None:
        status = FULL
        while status == FULL:
            status, written, struck = self._advance_code(
                self._drill,
                self._state,
                self._open_segment,
                self._open_impact,
                seconds,
                fraction,
                self._segment_room[self._written :],
                self._impact_room[self._struck :],
            )
            self._written += written
            self._struck += struck
            if status == FULL:
                self._grow()
        if status != DONE or not all(map(math.isfinite, _finite_values(self._state))):
            raise failure(status, self._parameters, self._drill, self._state)

    def _interrupt(
        self,
        seconds: int,
        fraction: float,
        drill: Drill,
        commands: tuple[float, ...],
    ) -> None:
        self._drill = drill
        self._reached = None
        self._struck += self._interrupt_code(
            drill,
            self._state,
            self._open_segment,
            self._open_impact,
            self.ahead(seconds, fraction),
            self._segment_room[self._written : self._written + 1],
            self._impact_room[self._struck :],
            commands,
        )
        self._written += 1
        if self._written == len(self._segment_room):
            self._grow()

    def ahead(self, seconds: int, fraction: float) -> float:
        start, rest = _time(self._state)
        return float(seconds - start) + (fraction - rest)

    def _make_room(self, segments: int) -> None:
        # Zeros, for the kernels leave out the bytes between two fields.
        self._segment_room = np.zeros(segments, SEGMENT)
        self._impact_room = np.zeros(2 * segments + 4, IMPACT)  # an event ends two at most

    def _grow(self) -> None:
        segments, impacts = self._segment_room, self._impact_room[: self._struck]
        self._make_room(2 * len(segments))
        self._segment_room[: len(segments)] = segments
        self._impact_room[: len(impacts)] = impacts
