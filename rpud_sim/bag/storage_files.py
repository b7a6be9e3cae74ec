"""Storage files of a bag: their names, their order, how each is opened, and their topics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, TypeAlias

from rpud_sim.bag.errors import BagFormatError, BagNotFoundError, reading
from rpud_sim.bag.losses import RECORD_NAME, Losses, losses_from_record
from rpud_sim.bag.mcap_file import McapFile
from rpud_sim.bag.metadata import FILE_NAME, local_name, read_document
from rpud_sim.bag.rosbag2_compression import (
    SUFFIX,
    compresses_messages,
    uncompress_file,
    uncompressed_limit,
)
from rpud_sim.bag.topic_summary import TopicSummary

if TYPE_CHECKING:
    from rpud_sim.bag.sqlite_file import SqliteFile

# Open file of either storage; a reader uses the members that both have.
StorageFile: TypeAlias = "McapFile | SqliteFile"

SUFFIXES = (".mcap", ".db3", f".mcap{SUFFIX}", f".db3{SUFFIX}")  # suffixes of storage files
_SQLITE = b"SQLite format 3\0"  # first bytes of rosbag2's storage sqlite3


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
        compressed = compresses_messages(metadata)
    if metadata.storage_identifier not in ("mcap", "sqlite3"):
        raise BagFormatError(
            f"{document}: storage is {metadata.storage_identifier!r:.80}; only 'mcap' and "
            "'sqlite3' are read"
        )
    names = [_inside(name, document) for name in metadata.relative_file_paths]
    if len(set(names)) < len(names):
        raise BagFormatError(f"{document}: a file is named twice")
    return [path / name for name in names], compressed


def open_storage_files(
    files: Sequence[Path], opened: ExitStack, *, unclosed: bool = False
) -> list[StorageFile]:
    """Open the files of a bag; only the first shows messages that it repeats of a previous one.

    ``unclosed`` is as for ``rpud_sim.bag.open``.
    """
    left = uncompressed_limit(files)
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
            path = uncompress_file(file, Path(folder), most)
        with path.open("rb") as stream:
            is_database = stream.read(len(_SQLITE)) == _SQLITE
    if is_database:
        from rpud_sim.bag.sqlite_file import SqliteFile  # loads what MCAP does not need

        return opened.enter_context(SqliteFile(path, file))
    return opened.enter_context(McapFile(path, repeats=first, shown=file, unclosed=unclosed))


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
            for record in file.records(RECORD_NAME):
                losses |= losses_from_record(record)
    except BagFormatError as error:
        errors[f"record {RECORD_NAME}"] = error
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


def in_order(files: Iterable[Path]) -> list[Path]:
    """Return files of a bag sorted by their numbers: ``run_10.mcap`` follows ``run_9.mcap``."""
    return sorted(files, key=_name_parts)


def _name_parts(file: Path) -> tuple[str, int, str]:
    name = Path(file.name.removesuffix(SUFFIX)).stem
    stem = name.rstrip("0123456789")
    digits = name[len(stem) :]
    return stem, len(digits), digits


def _inside(name: str, document: Path) -> PurePosixPath:
    pure = PurePosixPath(local_name(name))
    if pure.is_absolute() or ".." in pure.parts:
        raise BagFormatError(f"{document}: the file {name!r:.200} is outside of the bag")
    return pure
