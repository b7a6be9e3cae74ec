"""A simulation run again from its journal, with the messages that it gave."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import NODE_NAMES, to_configuration
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import faults_fields
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.scenario import Scenario, ScheduledFault
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.telemetry import Entry, Telemetry

_GREATEST_RATES = {"telemetry_rate": 1000, "sample_rate": 1_000_000}


class JournalError(ValueError):
    """The journal is none, or does not fit to itself; the text says where, in one line."""


class Rerun:
    """Does what the entries of a journal tell, one after the other.

    Its messages are those that the journal's simulation gave when everybody listened: those of
    ``Telemetry``, and ``faults``.
    """

    def __init__(self) -> None:
        self._simulation: Simulation | None = None

    @property
    def began(self) -> bool:
        """Whether a simulation has begun."""
        return self._simulation is not None

    @property
    def time(self) -> int:
        """Simulation time [ns]."""
        return self._simulation.time if self._simulation else 0

    @property
    def origin(self) -> int:
        """Stamp of simulation time zero [ns]."""
        return self._telemetry.origin if self._simulation else 0

    def do(self, entry: JournalEntry) -> Iterator[Entry]:
        """Go on to the time of an entry, do what it tells, and yield the messages.

        Raises:
            JournalError: if it cannot be done.
        """
        try:
            if entry.kind == "begin":
                self._begin(entry.content)
                return
            if self._simulation is None:
                raise JournalError("nothing has begun")
            if entry.time < self._simulation.time:
                raise JournalError(f"its time {entry.time} ns is before that of the one before it")
            yield from self.go_on_to(entry.time)
            yield from self._act(self._simulation, entry)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            reason = str(error) if isinstance(error, ValueError) else f"{error!r:.100}"
            raise JournalError(
                f"journal entry {entry.sequence} ({entry.kind:.20}) cannot be done: {reason}"
            ) from error

    def go_on_to(self, time: int) -> Iterator[Entry]:
        """Go on to a simulation time [ns], block by block, and yield the messages."""
        simulation = self._simulation
        while simulation is not None and simulation.time < time:
            number = boundaries_until(simulation.time, self._rate) + 1
            block = simulation.advance_to(min(boundary(number, self._rate), time))
            yield from self._telemetry.take(block, simulation.faults.since(block.start))
            yield from self._changed_faults(simulation)

    def _begin(self, content: Mapping[str, Any]) -> None:
        values = content["parameters"]
        rates = {name: _rate(name, values[name]) for name in _GREATEST_RATES}
        self._rate = rates["telemetry_rate"]
        self._telemetry = Telemetry(
            self._rate, rates["sample_rate"], float(values["block_duration"])
        )
        self._telemetry.reseed(content["seed"])
        known = {name: value for name, value in values.items() if name not in _OTHERS}
        faults = tuple(_scheduled(fault) for fault in content["faults"])
        self._simulation = Simulation(
            to_configuration(known),
            float(content["initial_phase"]),
            Scenario(content["seed"], faults),
        )
        self._told: object = self._simulation.faults.active

    def _act(self, simulation: Simulation, entry: JournalEntry) -> Iterator[Entry]:
        content = entry.content
        act: dict[str, Callable[[], object]] = {
            "weight_on_bit": lambda: simulation.apply(WeightOnBit(content["force"])),
            "drive": lambda: simulation.apply(
                Drive(content["enabled"], content["voltage"], content["frequency"])
            ),
            "configure": lambda: simulation.configure(to_configuration(content["parameters"])),
            "inject": lambda: simulation.inject(Fault(**content["fault"]), content["duration"]),
            "clear": lambda: simulation.clear(content["number"]),
            "clear_all": simulation.clear_all,
            "origin": lambda: self._move(content["origin"]),
            "stop": lambda: None,
        }
        if entry.kind in ("flush", "end"):
            yield from self._telemetry.flush()
        elif entry.kind in act:
            act[entry.kind]()
            yield from self._changed_faults(simulation)
        else:
            raise JournalError("there is no such kind")

    def _move(self, origin: int) -> None:
        self._telemetry.move(origin)
        self._told = None

    def _changed_faults(self, simulation: Simulation) -> Iterator[Entry]:
        if simulation.faults.active is not self._told:
            self._told = simulation.faults.active
            values = faults_fields(simulation.faults, simulation.time, self.origin)
            yield simulation.time, "faults", values


# Parameters of the node alone, which change nothing in its simulation but by way of the journal.
_OTHERS = tuple(name for name in NODE_NAMES if name != "drive_enabled")


def _rate(name: str, value: Any) -> int:
    rate = int(value)
    if not 1 <= rate <= _GREATEST_RATES[name]:
        raise JournalError(f"{name} = {rate} Hz is outside its range [1, {_GREATEST_RATES[name]}]")
    return rate


def _scheduled(planned: Mapping[str, Any]) -> ScheduledFault:
    fault = Fault(planned["kind"], planned["channel"], planned["magnitude"])
    return ScheduledFault(planned["onset"], planned["clear"], fault)
