"""Bags as rosbag2 writes them: a reader, a writer and a recovery that need no ROS.

All times are integer nanoseconds since the epoch, as in the files.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rpud_sim.bag.errors import BagError, BagExistsError, BagFormatError, BagNotFoundError
from rpud_sim.bag.losses import Losses
from rpud_sim.bag.messages import Message
from rpud_sim.bag.metadata import Topic
from rpud_sim.bag.qos import QosProfile
from rpud_sim.bag.reader import BagReader
from rpud_sim.bag.recovery import recover
from rpud_sim.bag.recovery_account import Recovery, TopicRecovery
from rpud_sim.bag.topic_summary import TopicSummary
from rpud_sim.bag.writer import BagWriter

if TYPE_CHECKING:
    from rpud_sim.bag.columns import Column, Kind
    from rpud_sim.bag.tables import Batch

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
    "QosProfile",
    "Recovery",
    "Topic",
    "TopicRecovery",
    "TopicSummary",
    "open",
    "recover",
]

# Loaded at first use: they need NumPy and the message compiler, which listing a bag does not.
_TABLE_TYPES = {
    "Batch": "rpud_sim.bag.tables",
    "Column": "rpud_sim.bag.columns",
    "Kind": "rpud_sim.bag.columns",
}


def __getattr__(name: str) -> Any:
    """Return a type of tables."""
    if name not in _TABLE_TYPES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_TABLE_TYPES[name]), name)


def __dir__() -> list[str]:
    """Return the public names, also those that are not loaded yet."""
    return __all__


def open(path: str | os.PathLike[str]) -> BagReader:
    """Open a bag for reading.

    Args:
        path: a bag's directory or one file of it: MCAP or SQLite, also compressed.

    Raises:
        BagNotFoundError: if there is no bag at ``path``.
        BagFormatError: if a file is damaged or incomplete.
    """
    return BagReader(path)
