"""Messages that a recorder lost, as metadata records of the bag."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from rpud_sim.bag.errors import parsing

RECORD_NAME = "rpud_losses"  # metadata record with the ``Losses`` of each topic

# Metadata record with the duration that a recorder loses at most if it is killed: ``max_loss`` [s].
RECORDING_RECORD = "rpud_recording"


@dataclass(frozen=True)
class Losses:
    """Numbers of lost messages of one topic."""

    # lost on the way to the recorder; None if the middleware does not number messages
    transport: int | None = 0
    queue: int = 0  # dropped because the recorder's queue was full
    damaged: int = 0  # arrived with unreadable data or an impossible time

    @property
    def total(self) -> int | None:
        """All lost messages; None if that is unknown."""
        return None if self.transport is None else self.transport + self.queue + self.damaged


def losses_to_record(losses: Mapping[str, Losses]) -> dict[str, str]:
    """Return the content of the metadata record, with one key for each topic."""
    return {topic: json.dumps(asdict(item)) for topic, item in losses.items()}


def losses_from_record(record: Mapping[str, str]) -> dict[str, Losses]:
    with parsing(f"the record {RECORD_NAME}"):
        return {topic: _losses(json.loads(text)) for topic, text in record.items()}


def _losses(value: Mapping[str, int | None]) -> Losses:
    transport = value["transport"]
    losses = Losses(
        None if transport is None else int(transport),
        int(value["queue"] or 0),
        int(value.get("damaged") or 0),
    )
    for count in (losses.transport or 0, losses.queue, losses.damaged):
        if not 0 <= count < 2**63:
            raise ValueError(f"{count:g} is no number of messages")
    return losses
