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
    from rpud_sim.bag.batches import Message, SerializedBatch
    from rpud_sim.bag.columns import Column, Kind
    from rpud_sim.bag.errors import (
        BagError,
        BagExistsError,
        BagFormatError,
        BagNotFoundError,
        BagWarning,
    )
    from rpud_sim.bag.mcap_reader import BagChunk
    from rpud_sim.bag.metadata import Losses, QosProfile, Topic, TopicSummary
    from rpud_sim.bag.reader import BagReader
    from rpud_sim.bag.recovery import recover
    from rpud_sim.bag.recovery_account import Recovery, TopicRecovery
    from rpud_sim.bag.tables import RowTable
    from rpud_sim.bag.writer import BagWriter, whole_bag

__all__ = [
    "BagChunk",
    "BagError",
    "BagExistsError",
    "BagFormatError",
    "BagNotFoundError",
    "BagReader",
    "BagWarning",
    "BagWriter",
    "Column",
    "Kind",
    "Losses",
    "Message",
    "QosProfile",
    "Recovery",
    "RowTable",
    "SerializedBatch",
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
    "columns": ("Column", "Kind"),
    "errors": ("BagError", "BagExistsError", "BagFormatError", "BagNotFoundError", "BagWarning"),
    "batches": ("Message", "SerializedBatch"),
    "metadata": ("Losses", "QosProfile", "Topic", "TopicSummary"),
    "mcap_reader": ("BagChunk",),
    "reader": ("BagReader",),
    "recovery": ("recover",),
    "recovery_account": ("Recovery", "TopicRecovery"),
    "tables": ("RowTable",),
    "writer": ("BagWriter", "whole_bag"),
}


def __getattr__(name: str) -> Any:
    """Return a public name, and keep it."""
    for module, names in _MODULES.items():
        if name in names:
            return globals().setdefault(name, getattr(import_module(f"{__name__}.{module}"), name))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the public names, also those that are not loaded yet."""
    return __all__


def open(path: str | os.PathLike[str]) -> BagReader:
    """Open a bag for reading; ``path`` is its directory or one MCAP file of it."""
    from rpud_sim.bag.reader import BagReader

    return BagReader(path)
