"""A bag of a run without ROS: the topics of the drill node, in simulation time from zero."""

from __future__ import annotations

import os
from collections.abc import Iterator

from rpud_sim.bag import BagWriter, QosProfile, Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.losses import RECORD_NAME, Losses, losses_to_record
from rpud_sim.cli.progress import progress_bar
from rpud_sim.simulation import Parameters, fields
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.configuration import Configuration, to_values
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.sampling import NANOSECONDS
from rpud_sim.simulation.scenario import Scenario
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.telemetry import (
    BLOCK_DURATION,
    SAMPLE_RATE,
    TELEMETRY_RATE,
    TYPES,
    Entry,
    Telemetry,
)

NAMESPACE = "/rpud"

# As discovery tells them of the node's publishers.
_OFFER = QosProfile()
_LATCHED_OFFER = QosProfile(durability="transient_local")
_LATCHED = ("status", "faults", "journal")

_RATES = {
    "telemetry_rate": TELEMETRY_RATE,
    "sample_rate": SAMPLE_RATE,
    "block_duration": BLOCK_DURATION,
}

# The bag's clock is the simulation's: nothing is late, and there is nobody to command.
_ACCOUNT = {
    "commands_accepted": 0,
    "commands_rejected": 0,
    "commands_lost": False,
    "commanders": 0,
    "deadlines_missed": 0,
    "messages_dropped": 0,
    "real_time_factor": 1.0,
    "lateness_max": 0.0,
    "lag": 0.0,
}


def write_offline_bag(
    path: str | os.PathLike[str],
    configuration: Configuration | Parameters,
    duration: float,
    phase: float = 0.0,
    scenario: Scenario | None = None,
    seed: int = 0,
) -> None:
    """Simulate and write what the drill node would publish; messages have the times of that.

    Args:
        path: folder of the new bag.
        configuration: of the drill, or its parameters alone.
        duration: simulated time [s].
        phase: of the vibration at time zero [cycles].
        scenario: faults that come by themselves.
        seed: of faulty signals.

    Raises:
        BagError: if the bag cannot be written.
        EngineError: if the simulation cannot go on.
        FaultError: if a fault of the scenario cannot be honoured.
    """
    if isinstance(configuration, Parameters):
        configuration = Configuration(configuration)
    journal = Journal()
    journal.begin({**to_values(configuration), **_RATES}, phase, seed, scenario)
    journal.note(0, "origin", origin=0)
    simulation = Simulation(configuration, phase, scenario, journal)
    telemetry = Telemetry()
    telemetry.reseed(seed)
    definitions = {name: find_definition(type_name) for name, type_name in TYPES.items()}
    codecs = {name: Codec(TYPES[name], text) for name, text in definitions.items()}
    with BagWriter(path) as bag:
        for name, type_name in TYPES.items():
            offer = _LATCHED_OFFER if name in _LATCHED else _OFFER
            topic = Topic(f"{NAMESPACE}/{name}", type_name, find_type_hash(type_name), (offer,))
            bag.add_topic(topic, definitions[name])
        for time, name, values in _messages(simulation, telemetry, duration, journal):
            bag.write(f"{NAMESPACE}/{name}", codecs[name].encode(values), time, time)
        losses = {f"{NAMESPACE}/{name}": Losses() for name in TYPES}
        bag.add_record(RECORD_NAME, losses_to_record(losses))


def _messages(
    simulation: Simulation, telemetry: Telemetry, duration: float, journal: Journal
) -> Iterator[Entry]:
    """Yield what the node publishes during a run, block by block."""
    end = round(duration * NANOSECONDS)
    with progress_bar(" s", duration) as bar:
        yield from _entries(journal)
        yield _faults(simulation)
        yield _status(simulation, "running")
        while simulation.time < end:
            active = simulation.faults.active
            number = boundaries_until(simulation.time, TELEMETRY_RATE) + 1
            block = simulation.advance_to(min(boundary(number, TELEMETRY_RATE), end))
            yield from telemetry.take(block, simulation.faults.since(block.start))
            if simulation.faults.active is not active:
                yield _faults(simulation)
            if block.end % NANOSECONDS == 0:
                yield _status(simulation, "running")
            bar.update((block.end - block.start) / NANOSECONDS)
        yield from telemetry.flush()
        journal.note(end, "end")
        yield from _entries(journal)
        yield _status(simulation, "stopped")


def _entries(journal: Journal) -> Iterator[Entry]:
    for entry in journal.take():
        yield entry.time, "journal", fields.journal_fields(entry, 0)


def _faults(simulation: Simulation) -> Entry:
    time = simulation.time
    return time, "faults", fields.faults_fields(simulation.faults, time, 0)


def _status(simulation: Simulation, state: str) -> Entry:
    values = fields.status_fields(
        simulation.time,
        state,
        simulation.parameters.regime,
        simulation.applied,
        0,
        **fields.drill_fields(simulation),
        **_ACCOUNT,
    )
    return simulation.time, "status", values
