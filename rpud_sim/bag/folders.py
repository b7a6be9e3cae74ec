"""Files of a bag: folders as rosbag2 and people leave them, and files that are not MCAP."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from contextlib import suppress
from filecmp import cmp
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from rpud_sim.bag.mcap_contents import REMEDY
from rpud_sim.bag.metadata import FILE_NAME, ReadMetadata, local_name, read_document
from rpud_sim.bag.records import reading
from rpud_sim.foundation.user_files import name_beside, open_file
from rpud_sim.messages.errors import BagFormatError, BagNotFoundError, OtherStorageError

_UNPACK = "unpack it first: "
# First bytes of files that are not MCAP: what they are, and what makes a bag of them. ``{}`` is the
# file, ``{folder}`` its folder.
_CONVERT = "rosbags-convert --src {} --dst NEW --dst-storage mcap"
_OTHERS = {
    b"#ROSBAG V": ("a bag of ROS 1", f"convert it: {_CONVERT}"),
    b"SQLite format 3\0": (
        "a SQLite bag",
        f"convert its folder: {_CONVERT.format('{folder}')} (without {FILE_NAME} there, first: "
        "ros2 bag reindex -s sqlite3 {folder})",
    ),
    b"\x28\xb5\x2f\xfd": ("a file that zstd compressed", f"{_UNPACK}zstd -d {{}}"),
    b"\x04\x22\x4d\x18": ("a file that lz4 compressed", f"{_UNPACK}lz4 -d {{}}"),
    b"PK\x03\x04": ("a ZIP archive", f"{_UNPACK}unzip {{}}"),
    b"7z\xbc\xaf": ("a 7-Zip archive", f"{_UNPACK}7z x {{}}"),
    b"\x1f\x8b": ("a file that gzip compressed", f"{_UNPACK}tar xzf {{}} or gunzip {{}}"),
    b"BZh": ("a file that bzip2 compressed", f"{_UNPACK}tar xjf {{}} or bunzip2 {{}}"),
    b"\xfd7zXZ\0": ("a file that xz compressed", f"{_UNPACK}tar xJf {{}} or unxz {{}}"),
    b"version https://git-lfs": ("only a pointer of Git LFS", "fetch the file: git lfs pull"),
    b"\0\5\x16\7": ("a file of macOS beside the real one", "open the file without ._"),
}
_TAR = b"ustar", ("a tar archive", f"{_UNPACK}tar xf {{}}")
_TAR_PLACE = 257  # offset of its mark [bytes]


class BagFiles(NamedTuple):
    """Storage files of a bag."""

    files: tuple[Path, ...]  # storage files, in the order of the metadata
    missing: tuple[str, ...] = ()  # missing files that the metadata lists, in words
    warnings: tuple[str, ...] = ()  # what a user should know of the choice
    gaps: tuple[str, ...] = ()  # missing files, by gaps in the numbers of the others, in words
    unlisted: tuple[Path, ...] = ()  # MCAP files beside them that the metadata does not list


def storage_files(path: Path) -> BagFiles:
    """Return the files of a bag; ``path`` is its folder, one file of it, or its metadata.

    What is not MCAP is an OtherStorageError that names what makes one of it.
    """
    with reading(path):
        if path.name == FILE_NAME and path.is_file():
            path = path.parent
        if path.is_file():
            _check_storage(path)
            return BagFiles((path,))
        if path.exists() and not path.is_dir():
            raise BagNotFoundError(f"{path} is neither a folder nor a regular file")
        if not path.is_dir():
            raise BagNotFoundError(f"there is no bag at {path}{name_beside(path)}")
    held = mcap_files(path)
    document = path / FILE_NAME
    if not document.is_file():
        if not held:
            _explain(path)
        # A killed rosbag2 leaves some files compressed and the last one not.
        for packed in sorted(path.glob("*.mcap.zstd")):
            if packed.with_suffix("") not in held:
                _check_storage(packed)
        found = _unlisted(path, held)
    else:
        metadata = _metadata(document)
        found = _listed(document, metadata, held)
    for file in found.files:
        _check_storage(file)
    return found


def mcap_files(folder: Path) -> list[Path]:
    """Return the MCAP files in a folder, by their numbers: ``run_10.mcap`` follows ``run_9.mcap``.

    Hidden files do not count, such as the ones that macOS puts beside the real files.
    """
    with reading(folder):
        found = [file for file in folder.iterdir() if file.suffix.lower() == ".mcap"]
    return sorted((file for file in found if not file.name.startswith(".")), key=_number_of)


def _number_of(file: Path) -> tuple[str, int, str]:
    """Return the name of a file without its number, and the number: its length, its digits."""
    stem = file.stem.rstrip("0123456789")
    digits = file.stem[len(stem) :]
    return stem, len(digits), digits


def without_copies(files: Sequence[Path]) -> BagFiles:
    """Return files without those that have the bytes of an earlier one, with a warning."""
    distinct: list[Path] = []
    warnings = []
    for file in files:
        for other in distinct:
            with reading(file):
                if file.is_file() and other.is_file() and cmp(file, other, shallow=False):
                    warnings.append(
                        f"{file} has the same bytes as {other.name:.200}: it is left out"
                    )
                    break
        else:
            distinct.append(file)
    return BagFiles(tuple(distinct), warnings=tuple(warnings))


def _unlisted(folder: Path, held: Sequence[Path]) -> BagFiles:
    """Return the files of a folder without metadata, and which ones their numbers lack.

    rosbag2 gives them the name of the folder and a number; others may mean anything by theirs.
    """
    own = f"{folder.absolute().name}_"
    numbers = [int(digits) for stem, _, digits in map(_number_of, held) if stem == own and digits]
    gaps = [
        f"{own}{before + 1}.mcap{f' and {after - before - 2} more' if after > before + 2 else ''}, "
        "between the numbers of other files, is missing"
        for before, after in pairwise(numbers)
        if after > before + 1
    ]
    return without_copies(held)._replace(gaps=tuple(gaps))


def _metadata(document: Path) -> ReadMetadata:
    try:
        with reading(document):
            return read_document(document)
    except BagFormatError as error:
        raise BagFormatError(f"{error}; {REMEDY}") from error


def _listed(document: Path, metadata: ReadMetadata, held: Sequence[Path]) -> BagFiles:
    """Return the files that the metadata lists, under other names where these are clear."""
    storage, mode = metadata.storage_identifier, metadata.compression_mode
    names = metadata.relative_file_paths
    if storage not in ("mcap", "") and not held:
        raise _to_convert(document, f"storage is {storage!r:.80}")
    if mode.lower() == "file":  # perhaps somebody has unpacked the files
        names = tuple(name.removesuffix(".zstd") for name in names)
    if mode.lower() not in ("", "none") and not (
        mode.lower() == "file" and all(_place(document, name) for name in names)
    ):
        raise _to_convert(document, f"compression_mode is {mode!r:.80}")
    places = [_place(document, name) for name in names]
    known = [place for place in places if place is not None]
    if len(set(known)) < len(known):
        raise BagFormatError(f"{document}: a file is named twice")
    if not names:
        return BagFiles(tuple(held))
    others = [file for file in held if file not in known]
    lacking = [name for name, place in zip(names, places, strict=True) if place is None]
    if len(others) != len(lacking):
        counts = metadata.message_counts.items()
        amount = {name: f" with {count} messages" for name, count in counts}
        missing = [
            f"{name:.200}, which {FILE_NAME} lists{amount.get(name, '')}, is missing"
            for name in lacking
        ]
        return BagFiles(tuple(known), tuple(missing), unlisted=tuple(others))
    renamed = dict(zip(lacking, others, strict=True))
    files = (place or renamed[name] for name, place in zip(names, places, strict=True))
    warnings = (
        f"{document} lists {name:.200}, which does not exist; {file.name:.200} is read instead"
        for name, file in renamed.items()
    )
    return BagFiles(tuple(files), warnings=tuple(warnings))


def _place(document: Path, name: str) -> Path | None:
    """Return the file of a name in the metadata; None if it does not exist.

    Older versions of rosbag2 write the folder before the name, and Windows writes backslashes.
    """
    own = local_name(name)
    plain = [PurePosixPath(own), PurePosixPath(own.replace("\\", "/"))]
    inside = [each for each in plain if not each.is_absolute() and ".." not in each.parts]
    for place in (*inside, PurePosixPath(plain[1].name)):
        with suppress(OSError, ValueError):  # a name that is too long, or has a zero
            if place.name not in ("", "..") and (document.parent / place).exists():
                return document.parent / place
    if not inside:
        raise BagFormatError(f"{document}: the file {name!r:.200} is outside of the bag")
    return None


def _explain(folder: Path) -> None:
    """Raise the error of a folder without metadata and MCAP files."""
    inner = []
    for other in sorted(folder.iterdir()):
        if other.is_file():
            _check_storage(other)
        elif other.is_dir() and ((other / FILE_NAME).is_file() or mcap_files(other)):
            inner.append(other)
    hint = f"; did you mean {' or '.join(map(str, inner[:3]))}?" if inner else ""
    raise BagNotFoundError(f"{folder} holds neither {FILE_NAME} nor an MCAP file{hint}")


def _check_storage(file: Path) -> None:
    """Raise an OtherStorageError for a file in another known format than MCAP."""
    if not file.is_file():
        return
    with reading(file), open_file(file) as stream:
        head = stream.read(512)
    known = [each for mark, each in _OTHERS.items() if head.startswith(mark)]
    if head[_TAR_PLACE:].startswith(_TAR[0]):
        known.append(_TAR[1])
    for what, remedy in known:
        shown, folder = shlex.quote(str(file)), shlex.quote(str(file.parent))
        raise OtherStorageError(f"{file} is {what}; {remedy.format(shown, shown, folder=folder)}")


def _to_convert(document: Path, reason: str) -> OtherStorageError:
    folder = shlex.quote(str(document.parent))
    return OtherStorageError(
        f"{document}: {reason}; rpud reads MCAP files with compressed chunks only. Convert it: "
        f"{_CONVERT.format(folder)}"
    )
