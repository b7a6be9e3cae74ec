"""Writer of a rosbag2 bag: a directory with MCAP files and ``metadata.yaml``."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from mcap.records import Schema

from rpud_sim.bag.bag_folder import CHUNK_SIZE, BagFolder
from rpud_sim.bag.errors import BagError
from rpud_sim.bag.latched import LatchedMessages
from rpud_sim.bag.message_block import MessageBlock
from rpud_sim.bag.messages import Message
from rpud_sim.bag.metadata import LATEST, Topic, dump_offered_qos
from rpud_sim.foundation.time import SECOND


class BagWriter:
    """New bag for serialized messages, complete when it is closed.

    Written messages are on the disk after ``flush``. A bag that was never closed lacks its index
    and ``metadata.yaml``; ``recover`` makes a whole bag of it. Each file of a split bag is whole
    and has all channels. It begins with the last messages of latched topics: on channels of their
    own, marked with ``rpud_repeated``, and with the log time of the message before. Threads must
    not share a writer.

    Args:
        compression: of the chunks: ``none``, ``lz4`` or ``zstd``.
        chunk_size: uncompressed size after which a chunk is closed [bytes].
        max_file_size: a new file begins before one is larger [bytes], unless a single message is.
        max_file_duration: a new file begins before one lasts longer [s].
        reserved: whether ``reserve`` keeps room on the disk to close the bag.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        compression: str = "zstd",
        chunk_size: int = CHUNK_SIZE,
        custom_data: Mapping[str, str] | None = None,
        max_file_size: int | None = None,
        max_file_duration: float | None = None,
        reserved: bool = False,
    ) -> None:
        self._folder = BagFolder(path, compression, chunk_size, custom_data, reserved)
        self._max_size = max_file_size
        self._max_duration = max_file_duration and round(max_file_duration * SECOND)
        self._channels: dict[str, int] = {}
        self._latched = LatchedMessages()
        self._began: int | None = None  # log time of the file's first message that is not repeated
        self._last = 0  # log time of the last message

    @property
    def path(self) -> Path:
        """Directory of the bag."""
        return self._folder.path

    @property
    def message_count(self) -> int:
        """Messages written so far, without repetitions in split files."""
        return self._folder.message_count

    @property
    def size(self) -> int:
        """Size of the files on the disk so far [bytes]."""
        return self._folder.size

    @property
    def closed_size(self) -> int:
        """Greatest size of the bag, were it split and closed now [bytes]."""
        return self._folder.closed_size + self._latched.size

    @property
    def file_count(self) -> int:
        """Files so far."""
        return self._folder.file_count

    def add_topic(self, topic: Topic, definition: str | None = None) -> None:
        """Declare a topic, with its type's ``ros2msg`` text if known, before its first message."""
        if topic.name in self._channels:
            raise BagError(f"topic {topic.name} was declared twice")
        schema = Schema(
            id=0,
            name=topic.type,
            encoding="" if definition is None else "ros2msg",
            data=(definition or "").encode(),
        )
        metadata = {
            "offered_qos_profiles": dump_offered_qos(topic.offered_qos),
            "topic_type_hash": topic.type_hash,
        }
        self._channels[topic.name] = self._folder.add_channel(topic, schema, metadata)
        self._latched.declare(topic)

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one serialized message, with times of receipt and sending [ns since the epoch]."""
        channel = self._channels.get(topic)
        if channel is None:
            raise BagError(f"topic {topic} was not declared before its first message")
        if not (0 <= log_time <= LATEST and 0 <= publish_time <= LATEST):
            raise _time_error(topic, log_time, publish_time)
        if self._is_full(len(data), log_time):
            self.split()
        self._folder.write(channel, data, log_time, publish_time)
        self._last = log_time
        if self._began is None:
            self._began = log_time
        if topic in self._latched:
            self._latched.note(Message(topic, log_time, publish_time, data))

    def write_blocks(self, blocks: Sequence[tuple[MessageBlock, np.ndarray]]) -> None:
        """Add many serialized messages at once.

        The file is the same as if they were written one by one in their order. With the messages of
        a topic comes the place of each among those of all blocks, int64, ascending. Messages of
        equal place follow each other as their blocks do.
        """
        blocks = [(block, places) for block, places in blocks if len(block)]
        for block, _ in blocks:
            self._check(block)
        latched = any(block.topic in self._latched for block, _ in blocks)
        if latched or self._max_size is not None or self._max_duration is not None:
            self._write_one_by_one(blocks)
            return
        self._folder.write_blocks(
            [(self._channels[block.topic], block, places) for block, places in blocks]
        )
        for block, places in blocks:
            if places[-1] == max(int(others[-1]) for _, others in blocks):
                self._last = int(block.log_times[-1])

    def _write_one_by_one(self, blocks: Sequence[tuple[MessageBlock, np.ndarray]]) -> None:
        order = sorted(
            (place, number, index)
            for number, (_, places) in enumerate(blocks)
            for index, place in enumerate(places.tolist())
        )
        for _, number, index in order:
            block = blocks[number][0]
            times = int(block.log_times[index]), int(block.publish_times[index])
            self.write(block.topic, block.message(index), *times)

    def _check(self, block: MessageBlock) -> None:
        if block.topic not in self._channels:
            raise BagError(f"topic {block.topic} was not declared before its first message")
        for times in (block.log_times, block.publish_times):
            wrong = np.flatnonzero((times < 0) | (times > LATEST))
            if len(wrong):
                first = int(wrong[0])
                raise _time_error(
                    block.topic, int(block.log_times[first]), int(block.publish_times[first])
                )

    def split(self) -> None:
        """Complete the file and go on in a new one that begins with the latched messages."""
        self._folder.split(
            (self._channels[message.topic], message.data, message.log_time, message.publish_time)
            for message in self._latched.at(self._last)
        )
        self._began = None

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        """Add a metadata record: named texts, such as how the bag was made."""
        self._folder.add_record(name, content)

    def reserve(self, size: int) -> bool:
        """Return whether a message of ``size`` bytes can be written and the bag then be closed.

        Other programs cannot use the room for it from now on.
        """
        return self._folder.hold(self._latched.size + size)

    def flush(self) -> None:
        """Close the chunk in progress and wait until everything written is on the disk."""
        self._folder.flush()

    def close(self) -> None:
        """Complete the bag with its index, its statistics and ``metadata.yaml``.

        A closed bag stays as it is. After a failed write this only releases the file.
        """
        self._folder.close()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()  # also after an error: what was written makes a whole bag

    def _is_full(self, size: int, log_time: int) -> bool:
        if self._began is None:
            return False
        if self._max_duration is not None and log_time - self._began >= self._max_duration:
            return True
        return self._max_size is not None and self._folder.open_size + size > self._max_size


def _time_error(topic: str, log_time: int, publish_time: int) -> BagError:
    return BagError(
        f"a message of {topic} has log_time {log_time} ns and publish_time "
        f"{publish_time} ns; both must be from 0 to {LATEST}"
    )
