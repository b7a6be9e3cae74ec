"""``rpud info``: content of a bag."""

from __future__ import annotations

import argparse
from datetime import datetime, timezone
from typing import Any

from rpud_sim.cli.options import add_bag_argument, add_json_argument
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.terminal import printable
from rpud_sim.foundation.time import SECOND, split_seconds

HELP = "list a bag's topics, counts, rates, times and losses"
EXAMPLE = "rpud info bags/first"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag_argument(parser)
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.bag import BagError

    with failing(BagError):
        content = _content(arguments.bag)
    print_json(content) if arguments.json else print(_text(content))
    return ExitCode.DONE


def _content(path: str) -> dict[str, Any]:
    """Return the content of a bag: times in integer nanoseconds, size in bytes, rates in Hz."""
    import rpud_sim.bag

    with rpud_sim.bag.open(path) as bag:
        return {
            "path": str(bag.path),
            "duration": bag.duration,
            "start_time": bag.start_time,
            "end_time": bag.end_time,
            "message_count": bag.message_count,
            "size": bag.size,
            "compression": bag.compression,
            "topics": [
                {
                    "name": summary.topic.name,
                    "type": summary.topic.type,
                    "message_count": summary.message_count,
                    "rate": summary.rate,
                    "losses": summary.losses.total if summary.losses else None,
                }
                for summary in bag.topics
            ],
        }


def _text(content: dict[str, Any]) -> str:
    has_times = content["message_count"] > 0
    compression = printable(content["compression"])
    lines = [
        f"bag       {printable(content['path'])}",
        f"duration  {content['duration'] / SECOND:.3f} s",
        f"start     {_moment(content['start_time']) if has_times else '-'}",
        f"end       {_moment(content['end_time']) if has_times else '-'}",
        f"messages  {content['message_count']}",
        f"size      {content['size'] / 1e6:.2f} MB, compression {compression}",
        "",
    ]
    head = ("topic", "type", "messages", "rate [Hz]", "lost")
    rows = [
        (
            topic["name"],
            topic["type"],
            topic["message_count"],
            "-" if topic["rate"] is None else f"{topic['rate']:.2f}",
            "unknown" if topic["losses"] is None else topic["losses"],
        )
        for topic in content["topics"]
    ]
    return "\n".join(lines + table(head, rows, left=2))


def _moment(nanoseconds: int) -> str:
    seconds, rest = split_seconds(nanoseconds)
    moment = datetime.fromtimestamp(seconds, tz=timezone.utc)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"
