"""Bags as rosbag2 writes them: a reader, a writer and a recovery that need no ROS.

All times are integer nanoseconds since the epoch, as in the files. What cannot be read or written
raises a ``BagError``: ``BagNotFoundError`` without a bag, ``BagFormatError`` where a part is
damaged, incomplete, beyond a limit or of an unknown form, ``BagExistsError`` where a new bag would
overwrite something, and ``BagError`` itself where the disk fails or a topic is unknown. Modules
below a reader or a writer may raise an ``OSError`` of the disk.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rpud_sim.bag.columns import Column, Kind
    from rpud_sim.bag.errors import BagError, BagExistsError, BagFormatError, BagNotFoundError
    from rpud_sim.bag.losses import Losses
    from rpud_sim.bag.messages import Message, Piece
    from rpud_sim.bag.metadata import Topic
    from rpud_sim.bag.qos import QosProfile
    from rpud_sim.bag.reader import BagReader
    from rpud_sim.bag.recovery import recover
    from rpud_sim.bag.recovery_account import Recovery, TopicRecovery
    from rpud_sim.bag.tables import Batch
    from rpud_sim.bag.topic_summary import TopicSummary
    from rpud_sim.bag.writer import BagWriter

__all__ = [
    "BagError",
    "BagExistsError",
    "BagFormatError",
    "BagNotFoundError",
    "BagReader",
    "BagWriter",
    "Batch",
    "Column",
    "Kind",
    "Losses",
    "Message",
    "Piece",
    "QosProfile",
    "Recovery",
    "Topic",
    "TopicRecovery",
    "TopicSummary",
    "open",
    "recover",
]

# Loaded at first use. A drill that records nothing uses this package too, and must run where the
# libraries of bags are missing; tables need NumPy, which listing a bag does not.
_MODULES = {
    "BagError": "errors",
    "BagExistsError": "errors",
    "BagFormatError": "errors",
    "BagNotFoundError": "errors",
    "BagReader": "reader",
    "BagWriter": "writer",
    "Batch": "tables",
    "Column": "columns",
    "Kind": "columns",
    "Losses": "losses",
    "Message": "messages",
    "Piece": "messages",
    "QosProfile": "qos",
    "Recovery": "recovery_account",
    "Topic": "metadata",
    "TopicRecovery": "recovery_account",
    "TopicSummary": "topic_summary",
    "recover": "recovery",
}


def __getattr__(name: str) -> Any:
    """Return a public name, and keep it."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, also those that are not loaded yet."""
    return __all__


def open(path: str | os.PathLike[str], *, unclosed: bool = False) -> BagReader:
    """Open a bag for reading.

    ``path`` is its directory or one file of it: MCAP or SQLite, also compressed. With ``unclosed``
    MCAP files that were not closed, or lost their end, are read as far as they are whole.
    """
    from rpud_sim.bag.reader import BagReader

    return BagReader(path, unclosed=unclosed)
