"""A bag of a run without ROS: the topics of the drill node, in simulation time from zero."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator

import numpy as np
from tqdm import tqdm

from rpud_sim.bag import BagWriter, QosProfile, Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.losses import RECORD_NAME, Losses, losses_to_record
from rpud_sim.simulation import Parameters, fields
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.sampling import NANOSECONDS, Times
from rpud_sim.simulation.simulation import Simulation

NAMESPACE = "/rpud"
TELEMETRY_RATE = 100  # Hz
SAMPLE_RATE = 50_000  # of the waveform [Hz]
BLOCK_RATE = 20  # blocks of waveform and trajectory a second [Hz]

TYPES = {
    "contact_force": "rpud_msgs/msg/ContactForce",
    "drill_tool": "rpud_msgs/msg/DrillTool",
    "joint_states": "sensor_msgs/msg/JointState",
    "nodal_plane": "rpud_msgs/msg/NodalPlane",
    "reacting_force": "rpud_msgs/msg/ReactingForce",
    "status": "rpud_msgs/msg/Status",
    "trajectory": "rpud_msgs/msg/Trajectory",
    "waveform": "rpud_msgs/msg/Waveform",
    "wrench": "geometry_msgs/msg/WrenchStamped",
}
# As discovery tells them of the node's publishers.
_OFFER = QosProfile()
_LATCHED_OFFER = QosProfile(durability="transient_local")

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

_Entry = tuple[int, str, fields.Fields]  # stamp [ns], topic, what the message says


def write_offline_bag(
    path: str | os.PathLike[str], parameters: Parameters, duration: float, phase: float = 0.0
) -> None:
    """Simulate and write what the drill node would publish.

    Args:
        path: folder of the new bag.
        parameters: of the drill.
        duration: simulated time [s].
        phase: of the vibration at time zero [cycles].

    Raises:
        BagError: if the bag cannot be written.
        EngineError: if the simulation cannot go on.
    """
    definitions = {name: find_definition(type_name) for name, type_name in TYPES.items()}
    codecs = {name: Codec(TYPES[name], text) for name, text in definitions.items()}
    with BagWriter(path) as bag:
        for name, type_name in TYPES.items():
            offer = _LATCHED_OFFER if name == "status" else _OFFER
            topic = Topic(f"{NAMESPACE}/{name}", type_name, find_type_hash(type_name), (offer,))
            bag.add_topic(topic, definitions[name])
        for stamp, name, values in _messages(parameters, duration, phase):
            bag.write(f"{NAMESPACE}/{name}", codecs[name].encode(values), stamp, stamp)
        losses = {f"{NAMESPACE}/{name}": Losses() for name in TYPES}
        bag.add_record(RECORD_NAME, losses_to_record(losses))


def _messages(parameters: Parameters, duration: float, phase: float) -> Iterator[_Entry]:
    """Yield what the node publishes during a run, block by block."""
    simulation = Simulation(parameters, phase)
    end = round(duration * NANOSECONDS)
    segments = 0
    # A bar appears only on a terminal, and only for what takes longer than two seconds.
    with tqdm(
        total=duration, unit=" s", delay=2.0, disable=None, leave=False, file=sys.stderr
    ) as bar:
        yield _status(simulation, "running")
        while simulation.time < end:
            number = simulation.time * BLOCK_RATE // NANOSECONDS + 1
            block = simulation.advance_to(min(number * NANOSECONDS // BLOCK_RATE, end))
            entries = [*_telemetry(block), *_impacts(block), *_waveform(block)]
            for values in fields.trajectory_fields(block, segments, 0):
                entries.append((fields.stamp_of(values), "trajectory", values))
            segments += len(block.segments)
            if block.end % NANOSECONDS == 0:
                entries.append(_status(simulation, "running"))
            yield from sorted(entries, key=lambda entry: entry[0])
            bar.update((block.end - block.start) / NANOSECONDS)
        yield _status(simulation, "stopped")


def _telemetry(block: Block) -> Iterator[_Entry]:
    """Yield the samples due after the block's start and until its end."""
    numbers = np.arange(
        block.start * TELEMETRY_RATE // NANOSECONDS + 1,
        block.end * TELEMETRY_RATE // NANOSECONDS + 1,
    )
    stamps = numbers * NANOSECONDS // TELEMETRY_RATE
    samples = block.sample(Times.from_nanoseconds(stamps))
    for index, stamp in enumerate(stamps.tolist()):
        yield stamp, "nodal_plane", fields.nodal_plane_fields(samples, index, stamp)
        yield stamp, "drill_tool", fields.drill_tool_fields(samples, index, stamp)
        yield stamp, "reacting_force", fields.reacting_force_fields(samples, index, stamp)
        yield stamp, "wrench", fields.wrench_fields(samples, index, stamp)
        yield stamp, "joint_states", fields.joint_state_fields(samples, index, stamp)


def _impacts(block: Block) -> Iterator[_Entry]:
    for impact in block.impacts:
        values = fields.contact_force_fields(impact, 0)
        yield fields.stamp_of(values), "contact_force", values


def _waveform(block: Block) -> Iterator[_Entry]:
    """Yield the block's samples as one message."""
    numbers = block.grid(SAMPLE_RATE)
    if numbers:
        samples = block.sample(Times.from_grid(numbers.start, len(numbers), SAMPLE_RATE))
        stamp = numbers.start * NANOSECONDS // SAMPLE_RATE
        values = fields.waveform_fields(samples, stamp, numbers.start, SAMPLE_RATE)
        yield stamp, "waveform", values


def _status(simulation: Simulation, state: str) -> _Entry:
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
