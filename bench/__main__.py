"""Run measurements and print each row beside its goal; ``--page`` writes those with a goal.

A measurement is a module here with a function of the same name, which yields rows.
"""

from __future__ import annotations

import argparse
import importlib
import re
import signal
import sys
import traceback

from bench.table import ROOT, Row, machine, table

MEASUREMENTS = ("engine", "bags", "lockstep", "replay", "recorder", "telemetry")
LONG = ("soak",)
"""Measurements that run only by their name."""
PAGE = ROOT / "docs/explanation/performance.md"
_MARKED = re.compile(r"(<!-- rows -->\n).*?(<!-- end of rows -->)", re.DOTALL)


def measure(name: str, seconds: float | None) -> tuple[list[Row], bool]:
    """Return the rows of a measurement, and whether it came to its end."""
    print(f"measuring: {name}", file=sys.stderr)
    found: list[Row] = []
    try:
        function = getattr(importlib.import_module(f"bench.{name}"), name)
        for row in function() if seconds is None else function(seconds):
            print(f"  {row}", file=sys.stderr, flush=True)
            found.append(row)
    except Exception:
        traceback.print_exc()
        return found, False
    return found, True


def main() -> int:
    """Do what the arguments ask for; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    names = ", ".join((*MEASUREMENTS, *LONG))
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {names}")
    parser.add_argument("--seconds", type=float, metavar="S", help="how long to listen to a node")
    parser.add_argument("--page", action="store_true", help="write rows with a goal into the page")
    arguments = parser.parse_args()
    if unknown := {*arguments.names} - {*MEASUREMENTS, *LONG}:
        parser.error(f"nothing is called {', '.join(sorted(unknown))}; there is {names}")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what it has started ends with it
    rows, failed = list[Row](), list[str]()
    for name in arguments.names or MEASUREMENTS:
        listens = name in ("telemetry", "soak")
        found, whole = measure(name, arguments.seconds if listens else None)
        rows += found
        failed += [] if whole else [name]
    text = "\n".join([*table(rows), "", machine()])
    print(text)
    if arguments.page:
        page = PAGE.read_text(encoding="utf-8")
        text = "\n".join([*table(row for row in rows if row.goal), "", machine()])
        PAGE.write_text(_MARKED.sub(rf"\1\n{text}\n\n\2", page), encoding="utf-8")
    if failed:
        print(f"failed: {', '.join(failed)}")
    missed = [row for row in rows if row.missed and row.name.startswith("soak")]
    return int(bool(failed or missed))


if __name__ == "__main__":
    sys.exit(main())
