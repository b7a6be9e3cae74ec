"""Bags of the drill's waveform that are as large as a test wants, written fast."""

import numpy as np

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition

WAVEFORM = "rpud_msgs/msg/Waveform"
_CHANNELS = ("nodal_plane_position", "actuator_position", "free_mass_position")
_CHANNELS += ("drill_tool_displacement", "contact_force", "reacting_force")
_COUNT = 2500  # samples of a block
_SECOND = 1_000_000_000


def long_waveform(path, size):
    """Write blocks of noise, not compressed, with so many bytes of samples."""
    definition = find_definition(WAVEFORM)
    codec = Codec(WAVEFORM, definition)
    numbers = np.random.default_rng(1)
    arrays = {name: numbers.normal(size=_COUNT) for name in _CHANNELS}
    with BagWriter(path, compression="none") as bag:
        bag.add_topic(Topic("/rpud/waveform", WAVEFORM), definition)
        for block in range(size // (_COUNT * len(_CHANNELS) * 8)):
            time = block * _SECOND // 20
            stamp = {"sec": time // _SECOND, "nanosec": time % _SECOND}
            fields = {"header": {"stamp": stamp, "frame_id": "f"}, "sequence": block * _COUNT}
            data = codec.encode({**fields, "sample_period": 2e-5, **arrays})
            bag.write("/rpud/waveform", data, time, time)
    return path
