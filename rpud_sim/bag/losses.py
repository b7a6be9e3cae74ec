"""Messages that a recorder knows it has lost, as a record in the bag."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from rpud_sim.bag.errors import BagFormatError

RECORD_NAME = "rpud_losses"


@dataclass(frozen=True)
class Losses:
    """Lost messages of one topic: on the way to the recorder, in its full queue, and damaged ones.

    `damaged` arrived as what cannot be a message, or with a time that cannot be. `transport` is
    None where the middleware does not number its messages, so that its losses are unknown.
    """

    transport: int | None = 0
    queue: int = 0
    damaged: int = 0

    @property
    def total(self) -> int | None:
        """All lost messages, or None where that is unknown."""
        return None if self.transport is None else self.transport + self.queue + self.damaged


def losses_to_record(losses: Mapping[str, Losses]) -> dict[str, str]:
    """Give the content of the metadata record, one key for each topic."""
    return {topic: json.dumps(asdict(item)) for topic, item in losses.items()}


def losses_from_record(record: Mapping[str, str]) -> dict[str, Losses]:
    """Read the content of the metadata record.

    Raises BagFormatError where it is not one.
    """
    try:
        return {topic: _losses(json.loads(text)) for topic, text in record.items()}
    except (
        AttributeError,
        KeyError,
        OverflowError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        raise BagFormatError(f"the record {RECORD_NAME} is unreadable: {error!r:.200}") from error


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
