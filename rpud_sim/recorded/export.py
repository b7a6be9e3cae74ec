"""Export of a bag: one file for each topic, written in bounded memory."""

from __future__ import annotations

import hashlib
import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import rpud_sim.bag
from rpud_sim.bag import TopicSummary
from rpud_sim.bag.own_records import MANIFEST_RECORD as MANIFEST
from rpud_sim.foundation.json_text import finite_values, json_text, name_of
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.columns import Column
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.output import SkippedParts, new_folder

# File with the account of an export, and with what the other files have no place for.
ACCOUNT = "export.json"

# Class of each in ``arrow_files``, which is imported when it is needed: Arrow may be missing.
FORMATS = {"parquet": "ParquetFile", "csv": "CsvFile"}


@dataclass(frozen=True)
class ExportedTopic:
    """Exported topic."""

    name: str  # of the topic
    type: str  # of its messages
    messages: int  # number of exported ones
    rows: int  # of its table
    path: str  # of its file, in the folder of the export
    size: int  # of its file [bytes]


@dataclass(frozen=True)
class Exported:
    """Result of an export."""

    path: str  # of the folder
    format: str  # one of ``FORMATS``
    topics: tuple[ExportedTopic, ...]  # in the order of their names
    left_out: dict[str, str]  # topics that cannot be tables, with the reason
    # amount and reason of the damaged parts that were skipped, by topic or record
    damaged: dict[str, str]


def export(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    file_format: str = "parquet",
    topics: Collection[str] | None = None,
    start: float = 0.0,
    duration: float | None = None,
    report: Callable[[int], object] = lambda messages: None,
) -> Exported:
    """Write one table for each topic; ``out`` appears when all tables are complete.

    Without ``topics`` these are all that can be tables. ``start`` counts from the beginning of the
    bag, ``duration`` is the longest part [s].
    """
    with rpud_sim.bag.open(path) as bag:
        if 0 < bag.duration < start * SECOND:
            held = bag.duration / SECOND
            raise RecordingError(
                f"start = {start:g} s is not in the {held:g} s that the bag holds", code=2
            )
        left_out = bag.left_out if topics is None else {}
        if left_out and len(left_out) == len(bag.readable_topics):
            name, reason = next(iter(left_out.items()))
            raise RecordingError(f"no topic of {bag.path} can be exported: {name:.200}: {reason}")
        damages = SkippedParts(bag)
        chosen = [
            summary
            for summary in bag.readable_topics
            if summary.topic.name not in left_out
            and (topics is None or summary.topic.name in topics)
        ]
        length = None if duration is None else round(duration * SECOND)
        # Before any file is created, so that an unknown topic leaves no file behind.
        batches = bag.tables(
            [summary.topic.name for summary in chosen] if topics is None else topics,
            round(start * SECOND),
            length,
            damages.add,
        )
        columns = {summary.topic.name: bag.columns(summary.topic.name) for summary in chosen}
        tables = {each.topic.name: _description(each, columns[each.topic.name]) for each in chosen}
        about = {
            "bag": str(bag.path),
            "bag_start_time": bag.start_time,
            "manifests": damages.records(bag, MANIFEST),
        }
        messages, rows = Counter[str](), Counter[str]()
        with new_folder(out) as folder:
            files: dict[str, Any] = {}
            with ExitStack() as opened:
                for name, table in tables.items():
                    metadata = {"rpud_sim": {**about, **table}}
                    stem = folder / file_stem(name)
                    files[name] = make_table(file_format, stem, columns[name], metadata)
                    opened.callback(files[name].close)
                for batch in batches:
                    files[batch.topic].write(batch.columns)
                    messages[batch.topic] += batch.message_count
                    rows[batch.topic] += len(batch)
                    report(batch.message_count)
            topics_made = (
                ExportedTopic(
                    name,
                    tables[name]["type"],
                    messages[name],
                    rows[name],
                    file.path.name,
                    file.path.stat().st_size,
                )
                for name, file in files.items()
            )
            exported = Exported(
                os.fspath(out), file_format, tuple(topics_made), left_out, damages.texts
            )
            write_account(folder, {**asdict(exported), **about, "tables": tables})
    return exported


def _description(summary: TopicSummary, columns: Sequence[Column]) -> dict[str, Any]:
    """Return the entry of a table in ``export.json``."""
    return {
        "topic": summary.topic.name,
        "type": summary.topic.type,
        "type_hash": summary.topic.type_hash,
        "losses": asdict(summary.losses) if summary.losses else None,
        "columns": {column.name: describe_column(column) for column in columns},
    }


def write_account(folder: Path, account: Mapping[str, Any]) -> None:
    text = json_text(finite_values(account, name_of), indent=2, ensure_ascii=False)
    (folder / ACCOUNT).write_text(text + "\n", "utf-8", "backslashreplace")


_ROS_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_LONGEST = 180  # bytes; file systems take 255


def file_stem(topic: str) -> str:
    """Return the name of a topic's file without its ending, as in ``rpud.contact_force``.

    Different topics have different names. A topic whose name is not one of ROS gets the prefix
    ``topic-``, and escapes for all characters that a path could interpret.
    """
    if _ROS_NAME.fullmatch(topic):
        stem = topic[1:].replace("/", ".")
    else:
        stem = "topic-" + quote(topic, safe="")
    if len(stem) > _LONGEST:
        stem = f"{stem[:_LONGEST]}-{hashlib.sha256(topic.encode()).hexdigest()[:16]}"
    return stem


def make_table(
    file_format: str, path: Path, columns: Sequence[Column], metadata: Mapping[str, Any]
) -> Any:
    """Return a new table of a format, for rows in its ``write``; ``path`` is without its ending."""
    from rpud_sim.recorded import arrow_files

    return getattr(arrow_files, FORMATS[file_format])(path, columns, metadata)


def describe_column(column: Column) -> dict[str, Any]:
    """Return the entry of a column in ``export.json``."""
    content = {"kind": column.kind.value, "unit": column.unit, "description": column.description}
    if column.dtype != object:
        content["dtype"] = str(column.dtype)
    return content
