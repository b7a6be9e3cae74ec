"""Faults, checked when they are made, their effects together, the ledger of a run, and signals.

Each fault on a channel is a stage through which the channel's messages pass, in the order of
injection. Messages are the dictionaries of ``rpud_sim.simulation.fields``; a stage changes a copy.
Each fault has its own stream of random numbers, from the seed and the fault's number. So a fault on
one channel changes nothing on another.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, short_repr
from rpud_sim.messages.batch import Batch, Fields
from rpud_sim.model.parameters import QUANTITIES, Parameters
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.fault_kinds import (
    CHANNEL_NEEDS,
    KINDS,
    FaultEffects,
    FaultKind,
    Stage,
    fault_text,
)
from rpud_sim.simulation.topics import CHANNELS, GROUND_TRUTH

# A binding raises the damping ratio up to this. The closed forms of the paper need less than
# critical damping, which is 1.
MOST_DAMPING_RATIO = 0.99


@dataclasses.dataclass(frozen=True)
class Fault:
    """Fault, immutable."""

    kind: str  # one of ``KINDS``
    channel: str = ""  # one of ``CHANNELS`` for a signal fault, empty for a physical one
    # magnitude in the unit of the kind; NaN means the kind's default. Kinds without a magnitude
    # take NaN or zero; it is stored as zero.
    magnitude: float = math.nan

    def __post_init__(self) -> None:
        if not (isinstance(self.kind, str) and self.kind in KINDS):
            hint = did_you_mean(self.kind, KINDS)
            raise ParameterError(f"fault kind = {short_repr(self.kind)} is unknown{hint}")
        self._check_channel()
        object.__setattr__(self, "magnitude", self._checked_magnitude())

    def __str__(self) -> str:
        return fault_text(self.kind, self.channel)

    @property
    def declared(self) -> FaultKind:
        return KINDS[self.kind]

    @property
    def physical(self) -> bool:
        return self.declared.physical

    def _check_channel(self) -> None:
        channel = self.channel
        if self.physical and channel != "":
            raise ParameterError(
                f"{self.kind} is a fault of the drill and has no channel, given "
                f"{short_repr(channel)}"
            )
        if self.physical or (isinstance(channel, str) and channel in CHANNELS):
            return
        if channel in GROUND_TRUTH:
            raise ParameterError(
                f"{self} is rejected: it is the ground truth; "
                f"channels that may fail are {', '.join(CHANNELS)}"
            )
        if channel == "":
            raise ParameterError(f"{self.kind} needs a channel: one of {', '.join(CHANNELS)}")
        raise ParameterError(
            f"channel of {self.kind} = {short_repr(channel)} is "
            f"unknown{did_you_mean(channel, CHANNELS)}"
        )

    def _checked_magnitude(self) -> float:
        kind, given = self.declared, self.magnitude
        quantity = kind.quantity_on(self.channel)
        left_open = isinstance(given, float) and math.isnan(given)
        if quantity is None:
            if not (left_open or given == 0.0):
                raise ParameterError(f"{self} has no magnitude, given {short_repr(given)}")
            return 0.0
        default = kind.default_on(self.channel)
        if left_open:
            return default
        hint = f"NaN means the default {default:g} {quantity.unit}".rstrip()
        try:
            number = float(quantity.check(f"magnitude of {self}", given))
        except ParameterError as error:
            raise ParameterError(f"{error}; {hint}") from None
        if number == kind.unchanging:
            raise ParameterError(f"magnitude of {self} = {number:g} would change nothing; {hint}")
        return number


def check_supported(fault: Fault, configuration: Configuration) -> None:
    """Reject a fault that would have no effect, or no meaning, in a configuration."""
    needs = fault.declared.needs
    if fault.channel in CHANNEL_NEEDS:
        needs = (CHANNEL_NEEDS[fault.channel], *needs)
    for need in needs:
        if reason := need(fault.magnitude, configuration):
            raise ParameterError(f"{fault} is not possible: it {reason}")


def supported_kinds(configuration: Configuration) -> tuple[str, ...]:
    """Return the kinds of faults that a configuration supports with their default magnitudes."""

    def supported(name: str, kind: FaultKind) -> bool:
        try:
            fault = Fault(name, "" if kind.physical else next(iter(CHANNELS)))
            check_supported(fault, configuration)
        except ParameterError:
            return False
        return True

    return tuple(name for name, kind in KINDS.items() if supported(name, kind))


def effects_of(
    faults: Iterable[Fault], parameters: Parameters, hardness: float = 1.0
) -> FaultEffects:
    """Return the effects of any faults, at most one of a kind, on a drill.

    ``hardness`` is a factor on the specific energy of the rock at time zero, without faults.
    """
    given = {fault.kind: fault.magnitude for fault in faults}
    rate = parameters.load_spring_rate
    healthy = FaultEffects(parameters=parameters, pushing_rate=rate, hardness=hardness)
    values = {**vars(parameters), **vars(healthy)}
    for name in reversed(KINDS):  # not in the order of injection: factors round otherwise
        for each, effect in KINDS[name].effects.items() if name in given else ():
            values[each] = effect(values[each], given[name])
    changed = {
        name: min(values[name], _most(parameters, name))
        for name, value in vars(parameters).items()
        if values[name] != value
    }
    values["parameters"] = parameters.replace(**changed) if changed else parameters
    return FaultEffects(**{name: values[name] for name in vars(healthy)})


def _most(parameters: Parameters, name: str) -> float:
    if name.endswith("damping_ratio"):
        return max(MOST_DAMPING_RATIO, float(getattr(parameters, name)))
    return QUANTITIES[name].maximum


# Greatest number of stored cleared faults; older ones are only counted.
MOST_CLEARED = 1000


@dataclasses.dataclass(frozen=True)
class FaultRecord:
    """Time during which a fault was active: the ground truth."""

    number: int  # counts the injected faults from 1
    fault: Fault  # injected fault
    onset: int  # simulation time at which it began [ns]
    clear: int | None = None  # simulation time at which it ended, None while active [ns]

    def active_at(self, time: int) -> bool:
        """Whether it is active at a simulation time [ns]: from its onset on, before its end."""
        return self.onset <= time and (self.clear is None or time < self.clear)


class FaultLedger:
    """Faults of a run: active ones and ended ones.

    Times are integer nanoseconds of simulation time.
    """

    def __init__(self) -> None:
        self._number = 0
        # faults in order of injection; the same object until one begins or ends; read-only
        self.active: tuple[FaultRecord, ...] = ()
        self._cleared: deque[FaultRecord] = deque(maxlen=MOST_CLEARED)
        self.forgotten = 0  # cleared faults that ``records`` no longer contains; read-only

    @property
    def records(self) -> tuple[FaultRecord, ...]:
        """Faults in order of injection; of cleared ones, the latest ``MOST_CLEARED``."""
        return tuple(sorted((*self._cleared, *self.active), key=lambda record: record.number))

    def since(self, time: int) -> tuple[FaultRecord, ...]:
        """Return faults that are active or ended after a time, in order of injection."""
        if not any((record.clear or 0) > time for record in self._cleared):
            return self.active
        return tuple(each for each in self.records if each.clear is None or each.clear > time)

    def inject(self, time: int, fault: Fault) -> int:
        for record in self.active:
            if (record.fault.kind, record.fault.channel) == (fault.kind, fault.channel):
                raise ParameterError(f"{fault} is already there as fault {record.number}")
        self._number += 1
        self.active = (*self.active, FaultRecord(self._number, fault, time))
        return self._number

    def clear(self, time: int, number: int) -> FaultRecord:
        found = [record for record in self.active if record.number == number]
        if not found:
            raise ParameterError(f"there is no fault {short_repr(number)} to clear")
        ended = dataclasses.replace(found[0], clear=time)
        self.active = tuple(record for record in self.active if record is not found[0])
        self.forgotten += len(self._cleared) == MOST_CLEARED
        self._cleared.append(ended)
        return ended

    def clear_all(self, time: int) -> None:
        for record in self.active:
            self.clear(time, record.number)


class SignalFaults:
    """Pipeline of the channels' batches through their faults."""

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._last: dict[str, Batch] = {}
        self._stages: dict[str, dict[int, Stage]] = {}

    @property
    def busy(self) -> bool:
        """Whether a fault acts on a channel, or holds messages of one."""
        return bool(self._stages)

    def apply(self, batch: Batch, records: Sequence[FaultRecord]) -> Iterable[Batch]:
        """Return the batches that a channel publishes instead of one, in order; maybe none.

        A healthy channel publishes the same one, whose fields must not change from now on. Times
        [ns] do not go back. ``records`` include all active faults; others are ignored.
        """
        own = [record for record in records if record.fault.channel == batch.topic]
        if not own and batch.topic not in self._stages:
            self._last[batch.topic] = batch
            return (batch,)
        return [
            Batch.of(time, channel, changed)
            for time, channel, fields in batch.rows()
            for changed in self._pass(channel, time, [fields], own)
        ]

    def release(self, time: int, records: Sequence[FaultRecord]) -> Iterator[Batch]:
        """Yield the late messages that are due; call it once a block."""
        for channel in tuple(self._stages):
            for fields in self._pass(channel, time, [], records):
                yield Batch.of(time, channel, fields)

    def _pass(
        self, channel: str, time: int, messages: list[Fields], records: Sequence[FaultRecord]
    ) -> list[Fields]:
        stages = self._stages.setdefault(channel, {})
        active = {
            record.number: record.fault
            for record in records
            if record.fault.channel == channel and record.active_at(time)
        }
        for number in sorted(active.keys() - stages.keys()):
            last = self._last.get(channel)
            seeds = np.random.SeedSequence(self._seed, spawn_key=(number,))
            message = last.row(len(last) - 1) if last else None
            magnitude, random = active[number].magnitude, np.random.default_rng(seeds)
            stages[number] = Stage(channel, magnitude, random, message)
        for number in sorted(stages):
            if number in active:
                act = active[number].declared.signal
                messages = act(stages[number], time, messages) if act else messages
            else:  # what still waits when a fault ends goes out
                messages = [*(fields for _, fields in stages.pop(number).waiting), *messages]
        if not stages:
            del self._stages[channel]
        if messages:
            self._last[channel] = Batch.of(time, channel, messages[-1])
        return messages
