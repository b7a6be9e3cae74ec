"""`rpud info`: what a bag holds."""

from __future__ import annotations

import argparse
import json
from datetime import datetime, timezone
from typing import Any

from rpud_sim.foundation.terminal import complain, printable, table
from rpud_sim.foundation.time import split_seconds

HELP = "list a bag's topics, counts, rates, times and losses"
EXAMPLE = "rpud info bags/first"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud info`."""
    parser.add_argument("bag", metavar="BAG", help="a bag's folder or one MCAP file")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Print what the bag holds; give the exit code."""
    from rpud_sim.bag import BagError

    try:
        content = _content(arguments.bag)
    except BagError as error:
        complain("rpud info", error)
        return 1
    print(json.dumps(content, indent=2) if arguments.json else _table(content))
    return 0


def _content(path: str) -> dict[str, Any]:
    """Collect what there is to tell: times in integer nanoseconds, size in bytes, rates in Hz."""
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


def _table(content: dict[str, Any]) -> str:
    held = content["message_count"] > 0
    compression = printable(content["compression"])
    lines = [
        f"bag       {printable(content['path'])}",
        f"duration  {content['duration'] / 1e9:.3f} s",
        f"start     {_moment(content['start_time']) if held else '-'}",
        f"end       {_moment(content['end_time']) if held else '-'}",
        f"messages  {content['message_count']}",
        f"size      {content['size'] / 1e6:.2f} MB, compression {compression}",
        "",
    ]
    head = ("topic", "type", "messages", "rate [Hz]", "lost")
    rows = [head] + [
        (
            topic["name"],
            topic["type"],
            str(topic["message_count"]),
            "-" if topic["rate"] is None else f"{topic['rate']:.2f}",
            "unknown" if topic["losses"] is None else str(topic["losses"]),
        )
        for topic in content["topics"]
    ]
    return "\n".join(lines + table(rows, left=2))


def _moment(nanoseconds: int) -> str:
    seconds, rest = split_seconds(nanoseconds)
    moment = datetime.fromtimestamp(seconds, tz=timezone.utc)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"
