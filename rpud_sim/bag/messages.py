"""Messages of a bag, and the parts of it that can be read by themselves."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from rpud_sim.bag.message_block import MessageBlock


class Message(NamedTuple):
    """One serialized message; a tuple, as it is made three times as fast as a data class."""

    topic: str  # its name
    log_time: int  # when it was received [ns since the epoch]
    publish_time: int  # when it was sent [ns since the epoch]
    data: bytes  # its bytes (CDR)


@dataclass(frozen=True)
class Piece:
    """Part of a bag that can be read by itself, such as a chunk."""

    start_time: int  # no message is earlier [ns]
    end_time: int  # no message is later [ns]
    size: int  # memory that its messages take [bytes]
    topics: frozenset[str]  # names of the topics that it may hold
    # returns the messages of topics in blocks, each in the order of log times; None for all. It
    # raises BagFormatError if the part is damaged.
    blocks: Callable[[Collection[str] | None], Iterable[MessageBlock]]
