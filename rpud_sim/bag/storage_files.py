"""Storage files of a bag: names, order, compression by rosbag2, how each is opened, topics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, TypeAlias

import zstandard

from rpud_sim.bag.errors import BagFormatError, BagNotFoundError
from rpud_sim.bag.losses import LOSSES_RECORD, Losses, losses_from_record
from rpud_sim.bag.mcap_file import McapFile
from rpud_sim.bag.messages import Message
from rpud_sim.bag.metadata import FILE_NAME, ReadMetadata, TopicSummary, local_name, read_document
from rpud_sim.bag.records import CONTENT_LIMIT, reading

if TYPE_CHECKING:
    from rpud_sim.bag.sqlite_file import SqliteFile

# Open file of either storage; a reader uses the members that both have.
StorageFile: TypeAlias = "McapFile | SqliteFile"

SUFFIX = ".zstd"  # suffix of a file that rosbag2 compressed
SUFFIXES = (".mcap", ".db3", f".mcap{SUFFIX}", f".db3{SUFFIX}")  # suffixes of storage files

_SQLITE = b"SQLite format 3\0"  # first bytes of rosbag2's storage sqlite3
_LEAST_LIMIT = 2**30  # bytes that the uncompressed files of any bag may have together
_MOST_GROWTH = 100  # uncompressed bytes for each compressed one, in larger bags
_BLOCK = 1 << 20


def storage_files(path: Path) -> tuple[list[Path], bool]:
    """Return a bag's files in the order of its metadata, and whether messages are compressed."""
    if path.is_file():
        return [path], False
    if not path.is_dir():
        raise BagNotFoundError(f"there is no bag at {path}")
    document = path / FILE_NAME
    if not document.is_file():
        files = in_order(file for suffix in SUFFIXES for file in path.glob(f"*{suffix}"))
        if not files:
            raise BagNotFoundError(f"{path} holds neither {FILE_NAME} nor an MCAP or SQLite file")
        return files, False
    with reading(document):
        metadata = read_document(document)
        compressed = _compresses_messages(metadata)
    if metadata.storage_identifier not in ("mcap", "sqlite3"):
        raise BagFormatError(
            f"{document}: storage is {metadata.storage_identifier!r:.80}; only 'mcap' and "
            "'sqlite3' are read"
        )
    names = []
    for name in metadata.relative_file_paths:
        names.append(PurePosixPath(local_name(name)))
        if names[-1].is_absolute() or ".." in names[-1].parts:
            raise BagFormatError(f"{document}: the file {name!r:.200} is outside of the bag")
    if len(set(names)) < len(names):
        raise BagFormatError(f"{document}: a file is named twice")
    return [path / name for name in names], compressed


def in_order(files: Iterable[Path]) -> list[Path]:
    """Return files of a bag sorted by their numbers: ``run_10.mcap`` follows ``run_9.mcap``."""

    def parts(file: Path) -> tuple[str, int, str]:
        name = Path(file.name.removesuffix(SUFFIX)).stem
        stem = name.rstrip("0123456789")
        digits = name[len(stem) :]
        return stem, len(digits), digits

    return sorted(files, key=parts)


def open_storage_files(
    files: Sequence[Path], opened: ExitStack, *, unclosed: bool = False
) -> list[StorageFile]:
    """Open the files of a bag; only the first shows messages that it repeats of a previous one.

    ``unclosed`` is as for ``rpud_sim.bag.open``.
    """
    compressed = (file for file in files if file.name.endswith(SUFFIX) and file.is_file())
    # Bytes that all compressed files may have when they are uncompressed.
    left = max(_LEAST_LIMIT, _MOST_GROWTH * sum(file.stat().st_size for file in compressed))
    found: list[StorageFile] = []
    for file in files:
        found.append(_open(file, file == files[0], opened, unclosed, left))
        left -= found[-1].size if file.name.endswith(SUFFIX) else 0
    return found


def _open(file: Path, first: bool, opened: ExitStack, unclosed: bool, most: int) -> StorageFile:
    """Open a file by its content, uncompressed first if its name says so."""
    path = file
    with reading(file):
        if file.exists() and not file.is_file():  # to open a FIFO may take forever
            raise BagFormatError(f"{file} is not a file")
        if file.name.endswith(SUFFIX):
            folder = opened.enter_context(TemporaryDirectory(prefix="rpud-"))
            path = _uncompressed_file(file, Path(folder), most)
        with path.open("rb") as stream:
            is_database = stream.read(len(_SQLITE)) == _SQLITE
    if is_database:
        from rpud_sim.bag.sqlite_file import SqliteFile  # loads what MCAP does not need

        return opened.enter_context(SqliteFile(path, file))
    return opened.enter_context(McapFile(path, repeats=first, shown=file, unclosed=unclosed))


def _compresses_messages(metadata: ReadMetadata) -> bool:
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


def _uncompressed_file(file: Path, folder: Path, most: int) -> Path:
    """Uncompress ``file`` into ``folder``, to ``most`` bytes, and return the new file's path."""
    path = folder / file.name.removesuffix(SUFFIX)
    size = 0
    with file.open("rb") as compressed, path.open("xb") as plain:
        reader = zstandard.ZstdDecompressor().stream_reader(compressed, read_across_frames=True)
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


def summarize(
    files: Sequence[StorageFile],
) -> tuple[tuple[TopicSummary, ...], dict[str, BagFormatError]]:
    """Return the readable topics of a bag by name, and the errors of damaged ones.

    The errors also name the record of losses if it is damaged.
    """
    topics: list[TopicSummary] = []
    errors: dict[str, BagFormatError] = {}
    losses: dict[str, Losses] = {}
    try:
        for file in files:
            for record in file.records(LOSSES_RECORD):
                losses |= losses_from_record(record)
    except BagFormatError as error:
        errors[f"record {LOSSES_RECORD}"] = error
    for name in sorted({name for file in files for name in file.topic_channels}):
        try:
            parts = [file.topic(name) for file in files if name in file.topic_channels]
        except BagFormatError as error:
            errors[name] = error
        else:
            topics.append(_joined(parts, losses.get(name)))
    return tuple(topics), errors


def _joined(parts: Sequence[TopicSummary], losses: Losses | None) -> TopicSummary:
    times = [time for part in parts for time in (part.first_time, part.last_time)]
    known = [time for time in times if time is not None]
    return TopicSummary(
        topic=parts[0].topic,
        message_count=sum(part.message_count for part in parts),
        first_time=min(known, default=None),
        last_time=max(known, default=None),
        definition=parts[0].definition,
        losses=losses,
        kinds=frozenset().union(*(part.kinds for part in parts)),
    )
