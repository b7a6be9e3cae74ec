"""Compression that rosbag2 adds to a storage: of whole files, or of each message."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import zstandard

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.messages import Message
from rpud_sim.bag.metadata import BagMetadata
from rpud_sim.bag.records import CONTENT_LIMIT

SUFFIX = ".zstd"  # suffix of a file that rosbag2 compressed
_LEAST_LIMIT = 2**30  # bytes that the uncompressed files of any bag may have together
_MOST_GROWTH = 100  # uncompressed bytes for each compressed one, in larger bags
_BLOCK = 1 << 20


def compresses_messages(metadata: BagMetadata) -> bool:
    """Return whether each message is compressed; compressed files have the suffix ``SUFFIX``."""
    mode = metadata.compression_mode.lower()
    if mode in ("", "none"):
        return False
    if mode not in ("file", "message"):
        raise BagFormatError(
            f"compression_mode is {metadata.compression_mode!r:.80}; "
            "only 'FILE' and 'MESSAGE' are read"
        )
    if metadata.compression_format.lower() != "zstd":
        raise BagFormatError(
            f"compression_format is {metadata.compression_format!r:.80}; only 'zstd' is read, "
            "and ros2 bag convert makes another bag of it"
        )
    return mode == "message"


def uncompressed_limit(files: Iterable[Path]) -> int:
    """Return how many bytes all of a bag's compressed files may have when they are uncompressed."""
    compressed = (file for file in files if file.name.endswith(SUFFIX) and file.is_file())
    return max(_LEAST_LIMIT, _MOST_GROWTH * sum(file.stat().st_size for file in compressed))


def uncompress_file(file: Path, folder: Path, most: int) -> Path:
    """Uncompress ``file`` into ``folder``, to ``most`` bytes, and return the new file's path."""
    path = folder / file.name.removesuffix(SUFFIX)
    decompressor = zstandard.ZstdDecompressor()
    with file.open("rb") as compressed, path.open("xb") as plain:
        reader = decompressor.stream_reader(compressed, read_across_frames=True)
        size = 0
        try:
            while block := reader.read(_BLOCK):
                size += len(block)
                if size > most:
                    raise BagFormatError(
                        "the bag's files are too large for their size when they are uncompressed: "
                        f"this one has more than {most} bytes"
                    )
                plain.write(block)
        except zstandard.ZstdError as error:
            raise BagFormatError(f"it cannot be uncompressed: {error}") from error
    if size == 0:
        raise BagFormatError("it holds nothing that can be uncompressed")
    return path


def uncompressed_messages(messages: Iterable[Message], path: Path) -> Iterator[Message]:
    """Yield the messages of the bag at ``path`` with uncompressed data."""
    for message in messages:
        try:
            data = _uncompressed(message.data)
        except BagFormatError as error:
            raise BagFormatError(f"{path}: {message.topic}: {error}") from error
        yield message._replace(data=data)


def _uncompressed(data: bytes) -> bytes:
    try:
        size = zstandard.frame_content_size(data)
        if not 0 <= size <= CONTENT_LIMIT:
            raise BagFormatError(
                f"a compressed message has {size} bytes; from 0 to {CONTENT_LIMIT} are read"
            )
        return zstandard.decompress(data, max_output_size=size) if size else b""
    except (zstandard.ZstdError, MemoryError) as error:
        raise BagFormatError(f"a message cannot be uncompressed: {error}") from error
