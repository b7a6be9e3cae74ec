"""Options of a recording. No ROS, so that help is quick."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

# Names of the writer's compressions; repeated, because the writer takes long to load.
COMPRESSIONS = ("none", "lz4", "zstd")


@dataclass(frozen=True)
class RecordOptions:
    """What to record, how to write it, and when to end."""

    out: str  # New folder of the bag

    # What to record.
    topics: Sequence[str] = ()  # Names relative to the namespace; all of the namespace if empty
    everything: bool = False  # Whether to record the topics of all namespaces
    # Expression to find in the names of further topics, of any namespace
    regex: re.Pattern[str] | None = None
    # Expression to find in the names of topics that are not recorded
    exclude: re.Pattern[str] | None = None
    namespace: str = "/rpud"  # Namespace to record and to resolve names in

    # How to write it.
    compression: str = "zstd"  # Compression of the bag's chunks, one of ``COMPRESSIONS``
    max_loss: float = 1.0  # Greatest time of messages that a crash of the recorder may cost [s]
    # Size at which a new file of the bag begins [bytes]; one file if None
    max_bag_size: int | None = None
    # Duration at which a new file of the bag begins [s]; one file if None
    max_bag_duration: float | None = None
    # Size of the whole bag at which the recording ends [bytes]; no limit if None
    max_disk: int | None = None
    max_cache_size: int = 256 * 2**20  # Size of messages that may wait for the disk [bytes]

    # When to record, and when to end.
    start_paused: bool = False  # Whether to record only when the service ``~/resume`` is called
    duration: float | None = None  # Time after which to stop [s]; at SIGINT or SIGTERM if None
    with_parent: bool = False  # Whether to stop also where the parent process has ended
    until_eof: bool = False  # Whether to stop also where standard input ends
    # Whether a bag without a requested topic, or without any message, is a success
    allow_empty: bool = False
    ready_fd: int | None = None  # Open file descriptor that gets one line when the recording begins
