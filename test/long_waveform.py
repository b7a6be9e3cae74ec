"""A bag of the drill's waveform of any size."""

from array import array
from pathlib import Path

import numpy as np

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition

WAVEFORM = "rpud_msgs/msg/Waveform"
CHANNELS = (
    "nodal_plane_position",
    "actuator_position",
    "free_mass_position",
    "drill_tool_displacement",
    "contact_force",
    "reacting_force",
)
BLOCK = 2500  # samples of a block
RATE = 50_000  # Hz

_SECOND = 1_000_000_000


def long_waveform(path: Path, size: int) -> Path:
    """Write blocks of noise on ``/rpud/waveform``, not compressed, with so many bytes of samples.

    Args:
        path: of the new bag.
        size: of the samples [bytes].
    """
    definition = find_definition(WAVEFORM)
    codec = Codec(WAVEFORM, definition)
    numbers = np.random.default_rng(1)
    arrays = {name: array("d", numbers.normal(size=BLOCK)) for name in CHANNELS}
    with BagWriter(path, compression="none") as bag:
        bag.add_topic(Topic("/rpud/waveform", WAVEFORM), definition)
        for block in range(size // (BLOCK * len(CHANNELS) * 8)):
            moment = block * BLOCK * _SECOND // RATE
            stamp = {"sec": moment // _SECOND, "nanosec": moment % _SECOND}
            fields = {"header": {"stamp": stamp, "frame_id": "rpud_mount"}}
            fields |= {"sequence": block * BLOCK, "sample_period": 1.0 / RATE, **arrays}
            bag.write_message("/rpud/waveform", codec.encode(fields), moment, moment)
    return path
