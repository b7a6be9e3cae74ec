"""Run measurements, print each figure beside its goal, and keep the results in build/bench.

``--page`` writes the newest results into the pages instead.
"""

from __future__ import annotations

import argparse
import importlib
import signal
import subprocess
import sys
import traceback
from collections.abc import Iterable
from datetime import datetime, timezone

from bench.machine import describe_machine, processor_time
from bench.page import KEPT, ROOT, write_page
from bench.table import Part, Row, heading, rows_of, table, write_parts

MEASUREMENTS = ("engine", "bags", "lockstep", "replay", "recorder", "telemetry", "drills")
"""Each is a module with a function of the same name, which yields rows."""


def measure(name: str, seconds: float | None = None) -> Part:
    """Return the result of a measurement, and keep it; an error ends this measurement only.

    Args:
        name: of the measurement.
        seconds: of listening to a node; None for the measurement's own.
    """
    began, (all_before, stolen_before) = datetime.now(timezone.utc), processor_time()
    found: list[Row] = []
    failure = ""
    try:
        function = getattr(importlib.import_module(f"bench.{name}"), name)
        rows: Iterable[Row] = function() if seconds is None else function(seconds)
        for row in rows:
            print(f"  {row}", file=sys.stderr, flush=True)
            found.append(row)
    except Exception as error:
        traceback.print_exc()
        failure = f"{type(error).__name__}: {' '.join(str(error).split())}"
    all_after, stolen_after = processor_time()
    stolen = 100.0 * (stolen_after - stolen_before) / max(all_after - all_before, 1e-9)
    part = Part(
        name,
        began.isoformat(timespec="seconds"),
        _commit(),
        describe_machine(),
        round(stolen, 2),
        tuple(found),
        failure,
    )
    write_parts(KEPT / f"{name}.json", [part])
    return part


def _commit() -> str:
    words = ("git", "-C", str(ROOT), "describe", "--always", "--exclude=*", "--dirty= with changes")
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def main() -> int:
    """Do what the arguments ask for; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    named = f"of {', '.join(MEASUREMENTS)}; default: all"
    parser.add_argument("names", nargs="*", metavar="NAME", help=named)
    parser.add_argument(
        "--telemetry-seconds", type=float, metavar="S", help="how long to listen to the node (600)"
    )
    parser.add_argument("--page", action="store_true", help="write the newest results into pages")
    arguments = parser.parse_args()
    if unknown := {*arguments.names} - {*MEASUREMENTS}:
        names = ", ".join(MEASUREMENTS)
        parser.error(f"nothing is called {', '.join(sorted(unknown))}; there is {names}")
    if arguments.page:
        write_page()
        return 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what it has started ends with it
    parts = []
    for name in arguments.names or MEASUREMENTS:
        print(f"measuring: {name}", file=sys.stderr)
        parts.append(measure(name, arguments.telemetry_seconds if name == "telemetry" else None))
    print("\n".join([*heading(parts), "", *table(rows_of(parts))]))
    failures = [part for part in parts if part.failure]
    for part in failures:
        print(f"failed: {part.measurement}: {part.failure}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
