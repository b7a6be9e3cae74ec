"""Recovery of a torn or damaged bag into a whole one."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from rpud_sim.bag.bag_folder import BagFolder
from rpud_sim.bag.errors import BagError, BagFormatError, BagNotFoundError, reading
from rpud_sim.bag.file_recovery import FileRecovery, add_custom_data
from rpud_sim.bag.metadata import FILE_NAME, BagMetadata, read_document
from rpud_sim.bag.reader import BagReader
from rpud_sim.bag.recovered_channels import RecoveredChannels
from rpud_sim.bag.recovery_account import Recovery
from rpud_sim.bag.scan import Damage, Scan
from rpud_sim.bag.storage_files import SUFFIXES, in_order, storage_files

# Metadata record of a recovered bag with the account of its recovery.
RECOVERY_RECORD = "rpud_recovery"

_OTHERS = (
    "rpud recover makes whole bags of MCAP files that are compressed by chunks alone: "
    "ros2 bag convert makes such a bag of others"
)


def recover(
    torn: str | os.PathLike[str],
    out: str | os.PathLike[str],
    progress: Callable[[int], object] = lambda _: None,
) -> Recovery:
    """Write a new bag from a torn one, which is not changed, and return the account.

    ``torn`` is an MCAP file or a bag's directory. A recovery that fails leaves nothing at ``out``.
    ``progress`` is called with the bytes that were read since the last call.
    """
    files = files_to_recover(torn)
    recovery = Recovery(Path(out))
    if not any(_holds_records(file) for file in files):
        raise BagFormatError(f"{torn} holds nothing of an MCAP file")
    bag = BagFolder(out)
    try:
        document = _document(Path(torn))
        add_custom_data(bag, recovery, document.custom_data if document else {})
        channels = RecoveredChannels(bag, recovery)
        for file in files:
            FileRecovery(file, bag, recovery, channels, file == files[0]).run(progress)
        channels.count_gaps()
        bag.add_record(RECOVERY_RECORD, {"account": json.dumps(recovery.to_mapping())})
        bag.close()
        with BagReader(bag.path) as whole:
            _ = whole.topics  # raises an error if the new bag cannot be listed
    except BaseException:
        with suppress(BagError):
            bag.close()
        shutil.rmtree(bag.path, ignore_errors=True)
        raise
    return recovery


def files_to_recover(torn: str | os.PathLike[str]) -> list[Path]:
    """Return the MCAP files of a bag, whether or not its metadata can be read."""
    path = Path(torn)
    document = _document(path)
    if document is not None and document.compression_mode.lower() not in ("", "none"):
        raise BagFormatError(
            f"{path / FILE_NAME}: compression_mode is {document.compression_mode!r:.80}; {_OTHERS}"
        )
    try:
        named, _ = storage_files(path)
    except BagFormatError:
        named = []
    for file in named:
        if not file.name.endswith(".mcap") and file.name.endswith(SUFFIXES):
            raise BagFormatError(f"{file} is no plain MCAP file; {_OTHERS}")
    files = [file for file in named if file.is_file()]
    if path.is_dir():
        # Of a torn bag the metadata may be missing, or be older than its last files.
        present = {file for file in path.glob("*.mcap") if file.is_file()}
        files += in_order(present - set(files))
    if not files:
        raise BagNotFoundError(f"there is no MCAP file at {torn}")
    return files


def _holds_records(file: Path) -> bool:
    with reading(file), file.open("rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        scan = Scan(stream, size)
        return scan.begins or any(not isinstance(item, Damage) for item in scan)


def _document(torn: Path) -> BagMetadata | None:
    """Return the metadata of a bag's directory; None if it cannot be read."""
    with suppress(BagError, OSError, ValueError):
        if torn.is_dir():
            return read_document(torn / FILE_NAME)
    return None
