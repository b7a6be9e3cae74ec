"""Computed messages of one topic and span, serialized and as fields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.inspection.encoded import encoded_columns
from rpud_sim.inspection.verify.messages import KEY_FIELDS, Key, computed_key
from rpud_sim.inspection.verify.recorded_journal import Position
from rpud_sim.simulation.fields import Fields
from rpud_sim.simulation.together import Columns, Together


@dataclass(frozen=True)
class ComputedBlock:
    """Computed messages of one topic, at least one; their keys ascend."""

    messages: MessageBlock  # serialized
    source: Columns  # the same as columns
    stretch: int  # of the journal in which they were computed
    ends: np.ndarray  # stamp of the end of each message's block [ns]

    def fields(self, number: int) -> Fields:
        return self.source.row(number)

    def key(self, number: int) -> Key:
        return computed_key(self.source.row(number, KEY_FIELDS))

    def position(self, number: int) -> Position:
        """Return the progress of the drill at a message."""
        return self.stretch, int(self.ends[number])


def computed_blocks(
    together: Together, codecs: Mapping[str, Codec], stretch: int, origin: int
) -> Iterator[tuple[str, ComputedBlock]]:
    """Yield each topic's messages, by its name in the run; ``origin`` is time zero's stamp [ns]."""
    ends = together.ends + origin
    for columns in together.columns:
        if columns.topic in codecs:
            messages = encoded_columns(columns, codecs[columns.topic].encoder, "")
            yield columns.topic, ComputedBlock(messages, columns, stretch, ends[columns.blocks])
