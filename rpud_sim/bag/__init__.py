"""Bags as rosbag2 understands them: a writer and a reader that need no ROS.

All times are integer nanoseconds since the epoch, as in the files themselves.
"""

import os

from rpud_sim.bag.errors import BagError, BagExistsError, BagFormatError, BagNotFoundError
from rpud_sim.bag.messages import Message
from rpud_sim.bag.metadata import Topic
from rpud_sim.bag.qos import QosProfile
from rpud_sim.bag.reader import BagReader
from rpud_sim.bag.storage_file import TopicSummary
from rpud_sim.bag.writer import BagWriter

__all__ = [
    "BagError",
    "BagExistsError",
    "BagFormatError",
    "BagNotFoundError",
    "BagReader",
    "BagWriter",
    "Message",
    "QosProfile",
    "Topic",
    "TopicSummary",
    "open",
]


def open(path: str | os.PathLike[str]) -> BagReader:
    """Open a bag's directory or one file of it for reading: MCAP or SQLite, also compressed.

    Raises BagNotFoundError, or BagFormatError where it is damaged or incomplete.
    """
    return BagReader(path)
