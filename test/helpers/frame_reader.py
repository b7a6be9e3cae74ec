"""Reader of frames, as the browser has one."""

import json

import numpy as np


def decode(data):
    """Return the frame of some bytes, with its arrays."""
    length = int.from_bytes(data[:4], "little")
    begin = 4 + length + -(4 + length) % 8

    def arrays(value):
        if value.keys() != {"$"}:
            return value
        offset, count, kind = value["$"]
        return np.frombuffer(data, f"<{kind}", count, begin + offset)

    return json.loads(data[4 : 4 + length], object_hook=arrays)
