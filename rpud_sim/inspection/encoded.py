"""Messages of a span of a run, serialized by topic."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.message_block import MessageBlock
from rpud_sim.simulation.together import Columns, Together


def encoded(
    together: Together, codecs: Mapping[str, Codec], prefix: str
) -> list[tuple[MessageBlock, np.ndarray]]:
    """Return the messages of each topic that has a codec, and their places among all.

    Args:
        together: the messages of a span.
        codecs: of the wanted topics, by their names in the run.
        prefix: of the names in a bag.
    """
    return [
        (encoded_columns(columns, codecs[columns.topic], prefix), columns.places)
        for columns in together.columns
        if columns.topic in codecs
    ]


def encoded_columns(columns: Columns, codec: Codec, prefix: str) -> MessageBlock:
    """Return the messages of columns."""
    data, sizes = codec.encode_columns(columns.fields, len(columns))
    times = columns.times
    starts = np.cumsum(sizes) - sizes
    return MessageBlock(prefix + columns.topic, times, times, data, starts, sizes)
