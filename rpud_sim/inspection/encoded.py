"""Messages of a span of a run, serialized by topic."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.message_block import MessageBlock
from rpud_sim.simulation.together import Columns, Single, Together


def encoded(
    together: Together, codecs: Mapping[str, Codec], prefix: str
) -> list[tuple[MessageBlock, np.ndarray]]:
    """Return the messages of each topic that has a codec, and their places among all.

    Args:
        together: the messages of a span.
        codecs: of the wanted topics, by their names in the run.
        prefix: of the names in a bag.
    """
    blocks = [
        (encoded_columns(columns, codecs[columns.topic], prefix), columns.places)
        for columns in together.columns
        if columns.topic in codecs
    ]
    for topic, group in together.grouped_singles().items():
        if topic in codecs:
            blocks.append((encoded_singles(group, codecs[topic], prefix), _places(group)))
    return blocks


def encoded_columns(columns: Columns, codec: Codec, prefix: str) -> MessageBlock:
    """Return the messages of columns."""
    count = len(columns)
    rows = codec.encode_columns(columns.fields, count)
    size = rows.shape[1]
    times = columns.times
    starts = np.arange(count, dtype=np.int64) * size
    sizes = np.full(count, size, np.int64)
    return MessageBlock(prefix + columns.topic, times, times, rows.reshape(-1), starts, sizes)


def encoded_singles(singles: list[Single], codec: Codec, prefix: str) -> MessageBlock:
    """Return the single messages of a topic, at least one."""
    data = [codec.encode(single.fields) for single in singles]
    times = np.array([single.time for single in singles], np.int64)
    sizes = np.array([len(each) for each in data], np.int64)
    starts = np.cumsum(sizes) - sizes
    joined = np.frombuffer(b"".join(data), np.uint8)
    return MessageBlock(prefix + singles[0].topic, times, times, joined, starts, sizes)


def _places(singles: list[Single]) -> np.ndarray:
    return np.array([single.place for single in singles], np.int64)
