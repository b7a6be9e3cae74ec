"""Run measurements, print each figure beside its goal, and keep the results.

``--compare BASE`` says instead what became slower or faster than a commit, and ends with 1 if
something is slower beyond the threshold. ``--page`` writes the newest results into the pages.
"""

from __future__ import annotations

import argparse
import functools
import importlib
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import datetime, timezone
from pathlib import Path

from bench import results
from bench.checkout import CheckoutError, state
from bench.compare import PAIRS, THRESHOLD, WORKS, compare
from bench.compare import rows as rows_of_ratios
from bench.machine import describe_machine, load, processor_time
from bench.ratios import FEWEST
from bench.results import Part
from bench.row import Row

# How long nodes are listened to in these measurements [s].
LISTENING: Mapping[str, float] = {"telemetry": 600.0, "arm": 60.0}
MEASUREMENTS: Mapping[str, str] = {
    "engine": "bench.engine:engine",
    "sweeps": "bench.sweep:sweeps",
    "ensembles": "bench.ensemble:ensembles",
    "dask": "bench.dask_sweep:dask",
    "offline": "bench.offline:offline",
    "reading": "bench.reading:reading",
    "profiles": "bench.profiles:profiles",
    "replay": "bench.replay:replay",
    "recorder": "bench.recorder:recorder",
    "telemetry": "bench.telemetry:telemetry",
    "arm": "bench.arm:arm",
    "drills": "bench.drills:drills",
    "start": "bench.start:start",
    "watch": "bench.watch:watch",
    "growth": "bench.growth:growth",
}
"""Functions that yield the rows of each measurement."""


class Keeper:
    """File of results that is written again after each part, so that none is lost."""

    def __init__(self, what: str = "") -> None:
        self.commit, self.changed = state()
        name = [f"{datetime.now(timezone.utc):%Y%m%dT%H%M%SZ}", self.commit[:7] or "unknown"]
        self.file = results.KEPT / f"{'-'.join(filter(None, [*name, what]))}.json"
        self.parts: list[Part] = []
        self._machine = describe_machine()

    def measure(self, name: str, rows: Callable[[], Iterable[Row]]) -> Part:
        """Take the rows of a measurement and keep them; an error ends this measurement alone."""
        began, before, started = datetime.now(timezone.utc), load(), time.monotonic()
        all_before, stolen_before = processor_time()
        found: list[Row] = []
        failure = ""
        try:
            for row in rows():
                print(f"  {next(iter(_plain([row])))}", file=sys.stderr, flush=True)
                found.append(row)
        except KeyboardInterrupt:
            failure = "interrupted"
        except Exception as error:
            traceback.print_exc()
            failure = f"{type(error).__name__}: {' '.join(str(error).split())}"
        all_after, stolen_after = processor_time()
        part = Part(
            name,
            began.isoformat(timespec="seconds"),
            self.commit,
            self.changed,
            self._machine,
            (before, load()),
            time.monotonic() - started,
            tuple(found),
            failure,
            round(100.0 * (stolen_after - stolen_before) / max(all_after - all_before, 1e-9), 2),
        )
        self.parts.append(part)
        results.write_parts(self.file, self.parts)
        return part


def _plain(rows: Iterable[Row]) -> Iterator[str]:
    for row in rows:
        yield f"{row.name}: {results.number(row.median)} {row.unit}".rstrip()


def find_measurement(name: str) -> Callable[..., Iterable[Row]]:
    """Return the function of a measurement.

    Args:
        name: of the measurement.

    Raises:
        ImportError: if what it needs is not installed.
    """
    module, _, function = MEASUREMENTS[name].partition(":")
    found: Callable[..., Iterable[Row]] = getattr(importlib.import_module(module), function)
    return found


def run_measurements(names: Iterable[str], listening: Mapping[str, float]) -> int:
    """Measure, print the table and what is missed; return the exit code.

    Args:
        names: of the measurements.
        listening: seconds for those that listen to nodes.
    """
    keeper = Keeper()
    for name in names:
        print(f"measuring: {name}", file=sys.stderr)
        arguments = (listening[name],) if name in listening else ()

        def rows(name: str = name, arguments: tuple[float, ...] = arguments) -> Iterable[Row]:
            return find_measurement(name)(*arguments)  # an import that fails is a part's failure

        part = keeper.measure(name, rows)
        if part.failure == "interrupted":
            break
    lines = [
        *results.heading(keeper.parts),
        "",
        *results.table(results.rows_of(keeper.parts)),
        "",
        *results.summary(keeper.parts),
    ]
    keeper.file.with_suffix(".md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))
    print(f"kept in {keeper.file}", file=sys.stderr)
    return 1 if any(part.failure for part in keeper.parts) else 0


def run_comparison(base: str, names: list[str], pairs: int, threshold: float) -> int:
    """Compare with a commit, print the verdicts and keep them; return the exit code."""
    keeper = Keeper("compare")
    try:
        ratios = compare(base, names, pairs)
    except CheckoutError as error:
        print(f"bench: {error}", file=sys.stderr)
        return 2
    keeper.measure(f"compare {base}", functools.partial(rows_of_ratios, ratios))
    for ratio in ratios:
        print(ratio)
    beyond = [ratio.name for ratio in ratios if ratio.beyond(threshold)]
    if beyond:
        print(f"slower by more than {threshold:.0%}: {', '.join(beyond)}")
    return 1 if beyond else 0


def main() -> int:
    """Do what the arguments ask for; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"of {', '.join(MEASUREMENTS)}; with --compare of {', '.join(WORKS)}; default: all",
    )
    for name, default in LISTENING.items():
        parser.add_argument(
            f"--{name}-seconds",
            type=float,
            default=default,
            metavar="S",
            help=f"how long {name} listens to its nodes (%(default)g)",
        )
    parser.add_argument("--compare", metavar="BASE", help="commit to compare the work tree with")
    parser.add_argument(
        "--pairs",
        type=int,
        default=PAIRS,
        metavar="N",
        help="times that both versions do each work (%(default)d)",
    )
    parser.add_argument(
        "--threshold",
        type=float,
        default=100.0 * THRESHOLD,
        metavar="PERCENT",
        help="what may be slower by so much without a failure (%(default)g)",
    )
    parser.add_argument("--page", action="store_true", help="write the newest results into pages")
    arguments = parser.parse_args()
    known = [*(WORKS if arguments.compare else MEASUREMENTS)]
    if unknown := set(arguments.names) - {*known}:
        parser.error(f"nothing is called {', '.join(sorted(unknown))}; there is {', '.join(known)}")
    if arguments.pairs < FEWEST:
        parser.error(f"--pairs is {arguments.pairs}; it must be at least {FEWEST}")
    if not 0.0 <= arguments.threshold < float("inf"):
        parser.error(f"--threshold is {arguments.threshold:g} %; it must be at least 0 %")
    listening = {name: getattr(arguments, f"{name}_seconds") for name in LISTENING}
    for name, seconds in listening.items():
        if not 0.0 < seconds < float("inf"):
            parser.error(f"--{name}-seconds is {seconds:g} s; it must be above 0 s")
    if arguments.page:
        from bench.page import write_pages

        return write_pages(Path(results.KEPT))
    if arguments.compare:
        share = arguments.threshold / 100.0
        return run_comparison(arguments.compare, arguments.names, arguments.pairs, share)
    names = [name for name in MEASUREMENTS if not arguments.names or name in arguments.names]
    return run_measurements(names, listening)


if __name__ == "__main__":
    sys.exit(main())
