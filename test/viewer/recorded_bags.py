"""Bags for the tests of a recorded drill: forces with chosen stamps, and a drill in many chunks."""

from __future__ import annotations

from pathlib import Path

from sample_bags import write_offline_bag

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario import read_scenario

SECOND = 1_000_000_000
FORCE = "rpud_msgs/msg/ReactingForce"
DURATION = 1.5
FAULTS = """
faults:
  - {kind: bias, channel: reacting_force, magnitude: 5, onset: 0.4, duration: 0.3}
  - {kind: restitution_loss, onset: 1.0}
"""


def write_forces(
    path: Path, rows, *, topic="/rpud/reacting_force", chunk_size=400, close=True
) -> Path:
    """Write messages of a force: rows are log time [ns], stamp [ns] and value [N]."""
    codec = Codec(FORCE, find_definition(FORCE))
    bag = BagWriter(path, chunk_size=chunk_size)
    bag.add_topic(Topic(topic, FORCE, find_type_hash(FORCE)), find_definition(FORCE))
    for log_time, stamp, value in rows:
        header = {"stamp": {"sec": stamp // SECOND, "nanosec": stamp % SECOND}, "frame_id": "f"}
        bag.write(topic, codec.encode({"header": header, "force": value}), log_time, log_time)
    if close:
        bag.close()
    else:
        bag.flush()
    return path


def rechunked(source: Path, out: Path, chunk_size: int, leave_out=()) -> Path:
    """Copy a bag with chunks of another size."""
    with rpud_sim.bag.open(source) as reader, BagWriter(out, chunk_size=chunk_size) as writer:
        kept = [each for each in reader.topics if each.topic.name not in leave_out]
        for summary in kept:
            writer.add_topic(summary.topic, summary.definition)
        for message in reader.messages({each.topic.name for each in kept}):
            writer.write(message.topic, message.data, message.log_time, message.publish_time)
    return out


def write_drill(folder: Path) -> Path:
    """Write a drill in the rock for ``DURATION``, with two faults, in some forty chunks."""
    (folder / "faults.yaml").write_text(FAULTS, encoding="utf-8")
    scenario = read_scenario(folder / "faults.yaml")
    write_offline_bag(folder / "whole", preset("drilling"), DURATION, scenario=scenario)
    return rechunked(folder / "whole", folder / "bag", 20_000, {"/rpud/waveform"})


def rows_of(count, stamp=0, first=0):
    """Return rows of a force that is the number of the message, a hundred a second."""
    step = SECOND // 100
    return [
        (number * step, stamp + number * step, float(number))
        for number in range(first, first + count)
    ]
