"""Studies of many runs: ``rpud sweep`` and ``rpud fit``."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import AT_MOST_ONE, JSON, command
from rpud_sim.cli.program import ExitCode, print_result, progress_bar
from rpud_sim.foundation.options import option, positional, required
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import printable, table

if TYPE_CHECKING:
    from rpud_sim.studies.fit.result import Fit
    from rpud_sim.studies.fit.target_file import FitSpecification

_CAUSES = 3  # inputs of a figure in the table; the page and indices.json have all
_PROCESSES = Quantity("", "processes", 1, 1024, whole=True)
_DRILLS = Quantity("", "synthetic drills", 10, 100_000, whole=True)


def _workers(**words: Any) -> Any:
    text = "processes on this machine (default: one for each of its cores)"
    return option(None, text, _PROCESSES, **words)


@command(
    "sweep",
    "config/sweep.yaml --out sweeps/first",
    "run a design of experiments over parameters, rocks and faults",
    "",
    JSON,
    spec=positional("SPEC", "the sweep, such as config/sweep.yaml"),
    out=required(
        "folder for tables and a page; finished parts of an earlier call are kept", metavar="DIR"
    ),
    workers=_workers(group=AT_MOST_ONE),
    scheduler=option(
        None,
        "run on the Dask cluster of this scheduler",
        metavar="tcp://HOST:PORT",
        group=AT_MOST_ONE,
    ),
)
def _sweep(options: Any) -> int:
    from rpud_sim.studies.sweep.specification_file import read_specification

    started = time.perf_counter()
    spec = read_specification(options.spec)
    from rpud_sim.studies.sweep.sweep import run_sweep

    out, workers = Path(options.out), _worker_count(options.workers)
    with progress_bar(" simulations", spec.simulations) as bar:
        result = run_sweep(spec, out, workers, options.scheduler, bar.update)
    wall = time.perf_counter() - started
    content = {
        "out": str(result.folder),
        **result.manifest,
        "run": result.simulations,
        "kept": result.kept,
        "failures": result.failures,
        "report": str(result.report),
        **({"indices": result.indices} if result.indices else {}),
        "wall_time": wall,
    }
    files = ["simulations.parquet", "points.parquet", *(["indices.json"] if result.indices else [])]
    lines = [
        f"{spec.point_count} points of {spec.repeat} simulations of {spec.duration:g} s: "
        f"{result.simulations} run, {result.kept} kept, {result.failures} failed, in {wall:.1f} s",
        *_indices(result.indices),
        *(printable(path) for path in (*(result.folder / name for name in files), result.report)),
    ]
    print_result(options, content, lambda: lines)
    return ExitCode.DONE


def _indices(indices: Mapping[str, Any]) -> list[str]:
    """Return a table of the figures, with the inputs that cause most of their variance."""
    rows = []
    for name, item in indices.items():
        if "missing" in item:
            rows.append((name, item["unit"], *4 * ("-",), item["missing"]))
            continue
        ranked = sorted(item["inputs"].items(), key=lambda each: -each[1]["total"])
        causes = (f"{cause} {share['total']:.2f}" for cause, share in ranked[:_CAUSES])
        numbers = (f"{value:.4g}" for value in (item["mean"], *item["interval_90"]))
        noise = f"{item['noise_share']:.2f}"
        rows.append((name, item["unit"], *numbers, noise, ", ".join(causes)))
    head = ("figure", "unit", "mean", "5 %", "95 %", "noise", "greatest shares in all")
    return table(head, rows, 2) if rows else []


@command(
    "fit",
    "config/fit_paper_drilling.yaml --out fits/drilling",
    "fit parameters, with intervals, to figures or data of a drill",
    "With --prove it fits synthetic drills instead, and counts how many intervals are right.",
    JSON,
    targets=positional("TARGETS", "the fit, such as config/fit_paper_drilling.yaml"),
    out=required(
        "folder for numbers, parameters and a page; finished runs of an earlier call are kept",
        metavar="DIR",
    ),
    workers=_workers(),
    prove=option(
        None,
        "fit N synthetic drills of known parameters and count the intervals that hold them",
        _DRILLS,
    ),
)
def _run_fit(options: Any) -> int:
    from rpud_sim.studies.fit.target_file import read_target_file

    specification = read_target_file(options.targets)
    return (_prove if options.prove else _fit)(options, specification)


def _fit(options: Any, specification: FitSpecification) -> int:
    from rpud_sim.studies.fit.fit import most_simulations, run_fit
    from rpud_sim.studies.fit.result import fit_content, write_fit

    started = time.perf_counter()
    out = Path(options.out)
    with progress_bar(" runs", most_simulations(specification)) as bar:
        fit = run_fit(specification, out, _worker_count(options.workers), bar.update)
    write_fit(fit, out, f"rpud fit {shlex.quote(options.targets)} --out DIR")
    took = f"{fit.simulations} runs, {fit.kept} kept, in {time.perf_counter() - started:.0f} s"
    content = {"out": str(out), **fit_content(fit), "run": fit.simulations, "kept": fit.kept}
    took = f"{took}: {printable(out)}/report.html"
    print_result(options, content, lambda: (*fit_lines(fit), took))
    return ExitCode.INCOMPLETE if fit.refusal else ExitCode.DONE


def _prove(options: Any, specification: FitSpecification) -> int:
    from rpud_sim.studies.fit.fit import proof_simulations, run_proof

    drills = options.prove
    with progress_bar(" runs", proof_simulations(specification, drills) + drills) as bar:
        workers = _worker_count(options.workers)
        proof = run_proof(specification, Path(options.out), workers, drills, bar.update)
    print_result(options, proof, lambda: _proof_lines(proof))
    return ExitCode.DONE if proof["holds"] else ExitCode.FAILED


def fit_lines(fit: Fit) -> Iterator[str]:
    from rpud_sim.studies.fit.result import target_table, unknown_table

    if fit.missed:
        yield f"not met: {fit.refusal}; there are no intervals"
        yield from (item.miss for item in fit.missed)
    elif fit.refusal:
        yield f"no intervals: {fit.refusal}"
    heading, unknowns = unknown_table(fit)
    yield from table(heading, unknowns, left=len(heading))
    yield from (f"{choices}: probability {share}" for choices, share in fit.choices)
    yield from (f"ridge: {ridge}" for ridge in fit.ridges)
    yield from table(*target_table(fit), left=1)
    yield f"misfit {fit.misfit_text}"


def _proof_lines(proof: dict[str, Any]) -> Iterator[str]:
    for name, found in proof["covered"].items():
        low, high = found["interval"]
        yield (
            f"{name:28} {found['count']} of {proof['drills']} intervals hold the true value: "
            f"{100 * found['share']:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"
        )
    verdict = "within" if proof["holds"] else "outside"
    yield (
        f"{100 * proof['level']:g} % is {verdict} the expected scatter; {proof['refused']} "
        "synthetic drills have no intervals"
    )


def _worker_count(given: int | None) -> int:
    """Return how many processes work; by default one for each core that this process may use."""
    return given or len(os.sched_getaffinity(0))
