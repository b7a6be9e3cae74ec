"""Run measurements; all of them write one table as bench/results.json and bench/results.md."""

from __future__ import annotations

import argparse
import functools
import json
import os
import platform
import sys
from pathlib import Path

from bench.engine import engine
from bench.recorder import recorder
from bench.replay import replay
from bench.row import Row
from bench.start import start
from bench.sweep import sweeps
from bench.telemetry import SECONDS, telemetry


def main() -> None:
    """Measure, print the table, and write it if it is whole."""
    measurements = {each.__name__: each for each in (engine, start, replay, sweeps, recorder)}
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"one of {', '.join([*measurements, 'telemetry'])}; without any, all of them",
    )
    parser.add_argument(
        "--telemetry-seconds",
        type=float,
        default=SECONDS,
        metavar="S",
        help=f"how long the node is listened to at each of its loads ({SECONDS:g})",
    )
    arguments = parser.parse_args()
    measurements["telemetry"] = functools.partial(telemetry, arguments.telemetry_seconds)
    if unknown := set(arguments.names) - measurements.keys():
        parser.error(f"there is no measurement {', '.join(sorted(unknown))}")

    rows: list[Row] = []
    for name, measure in measurements.items():
        if not arguments.names or name in arguments.names:
            print(f"measuring: {name}", file=sys.stderr)
            rows.extend(measure())
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    lines = [
        f"Measured on {machine}.",
        "",
        "| figure | median | least | greatest | unit |",
        "|---|---|---|---|---|",
        *(
            f"| {row.name} | {row.median:.3g} | {row.least:.3g} | {row.greatest:.3g} | {row.unit} |"
            for row in rows
        ),
    ]
    if not arguments.names:
        folder = Path(__file__).parent
        (folder / "results.md").write_text("\n".join(lines) + "\n")
        content = {"machine": machine, "rows": [row._asdict() for row in rows]}
        (folder / "results.json").write_text(json.dumps(content, indent=2) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
