"""Messages of a span of a run, serialized by topic."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rpud_sim.bag.encoder import Encoder
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.simulation.together import Columns, Together


def encoded(
    together: Together, encoders: Mapping[str, Encoder], prefix: str
) -> list[tuple[MessageBlock, np.ndarray]]:
    """Return the messages of each topic that has an encoder, and their places among all.

    ``encoders`` are by the names of topics in the run, ``prefix`` is of the names in a bag.
    """
    return [
        (encoded_columns(columns, encoders[columns.topic], prefix), columns.places)
        for columns in together.columns
        if columns.topic in encoders
    ]


def encoded_columns(columns: Columns, encoder: Encoder, prefix: str) -> MessageBlock:
    data, sizes = encoder.encode_columns(columns.fields, len(columns))
    times = columns.times
    starts = np.cumsum(sizes) - sizes
    return MessageBlock(prefix + columns.topic, times, times, data, starts, sizes)
