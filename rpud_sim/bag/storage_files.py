"""Storage files of a bag: their names, their order, and how each is opened."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, TypeAlias

from rpud_sim.bag.errors import BagFormatError, BagNotFoundError, reading
from rpud_sim.bag.mcap_file import McapFile
from rpud_sim.bag.metadata import FILE_NAME, local_name, read_document
from rpud_sim.bag.rosbag2_compression import SUFFIX, compresses_messages, uncompress_file

if TYPE_CHECKING:
    from rpud_sim.bag.sqlite_file import SqliteFile

StorageFile: TypeAlias = "McapFile | SqliteFile"
"""Open file of either storage; a reader uses the members that both have."""

SUFFIXES = (".mcap", ".db3", f".mcap{SUFFIX}", f".db3{SUFFIX}")
"""Suffixes of storage files."""

_SQLITE = b"SQLite format 3\0"  # first bytes of rosbag2's storage sqlite3


def storage_files(path: Path) -> tuple[list[Path], bool]:
    """Return the files of a bag in the order of its metadata, and whether messages are compressed.

    Raises:
        BagNotFoundError: if there is no bag at ``path``.
        BagFormatError: if its metadata is damaged.
    """
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


def open_storage_files(files: Sequence[Path], opened: ExitStack) -> list[StorageFile]:
    """Open the files of a bag; only the first shows messages that it repeats of a previous one.

    Args:
        files: of the bag, in their order.
        opened: closes them later.

    Raises:
        BagNotFoundError: if a file does not exist.
        BagFormatError: if a file is damaged or incomplete.
    """
    return [_open(file, file == files[0], opened) for file in files]


def _open(file: Path, first: bool, opened: ExitStack) -> StorageFile:
    """Open a file by its content, uncompressed first if its name says so."""
    path = file
    with reading(file):
        if file.exists() and not file.is_file():  # to open a FIFO may take forever
            raise BagFormatError(f"{file} is not a file")
        if file.name.endswith(SUFFIX):
            folder = opened.enter_context(TemporaryDirectory(prefix="rpud-"))
            path = uncompress_file(file, Path(folder))
        with path.open("rb") as stream:
            is_database = stream.read(len(_SQLITE)) == _SQLITE
    if is_database:
        from rpud_sim.bag.sqlite_file import SqliteFile  # loads what MCAP does not need

        return opened.enter_context(SqliteFile(path, file))
    return opened.enter_context(McapFile(path, repeats=first, shown=file))


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
