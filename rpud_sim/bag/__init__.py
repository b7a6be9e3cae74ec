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
    from rpud_sim.bag.mcap_reader import BagChunk
    from rpud_sim.bag.metadata import Losses, QosProfile, Topic, TopicSummary
    from rpud_sim.bag.reader import BagReader
    from rpud_sim.bag.recovery import recover
    from rpud_sim.bag.recovery_account import Recovery, TopicRecovery
    from rpud_sim.bag.tables import RowTable
    from rpud_sim.bag.writer import BagWriter, whole_bag
    from rpud_sim.messages.batch import Batch, Message
    from rpud_sim.messages.columns import Column, Kind
    from rpud_sim.messages.errors import (
        BagError,
        BagExistsError,
        BagFormatError,
        BagNotFoundError,
        BagWarning,
    )

__all__ = [
    "BagChunk",
    "BagError",
    "BagExistsError",
    "BagFormatError",
    "BagNotFoundError",
    "BagReader",
    "BagWarning",
    "BagWriter",
    "Batch",
    "Column",
    "Kind",
    "Losses",
    "Message",
    "QosProfile",
    "Recovery",
    "RowTable",
    "Topic",
    "TopicRecovery",
    "TopicSummary",
    "open",
    "recover",
    "whole_bag",
]

# Loaded at first use. A drill that records nothing uses this package too, and must run where the
# libraries of bags are missing.
_MODULES = {
    "messages.batch": ("Batch", "Message"),
    "messages.columns": ("Column", "Kind"),
    "messages.errors": (
        "BagError",
        "BagExistsError",
        "BagFormatError",
        "BagNotFoundError",
        "BagWarning",
    ),
    "bag.metadata": ("Losses", "QosProfile", "Topic", "TopicSummary"),
    "bag.mcap_reader": ("BagChunk",),
    "bag.reader": ("BagReader",),
    "bag.recovery": ("recover",),
    "bag.recovery_account": ("Recovery", "TopicRecovery"),
    "bag.tables": ("RowTable",),
    "bag.writer": ("BagWriter", "whole_bag"),
}


def __getattr__(name: str) -> Any:
    """Return a public name, and keep it."""
    for module, names in _MODULES.items():
        if name in names:
            return globals().setdefault(name, getattr(import_module(f"rpud_sim.{module}"), name))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the public names, including names that are not loaded yet."""
    return __all__


def open(path: str | os.PathLike[str]) -> BagReader:
    """Open a bag for reading; ``path`` is its directory or one MCAP file of it."""
    from rpud_sim.bag.reader import BagReader

    return BagReader(path)
