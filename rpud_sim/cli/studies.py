"""Studies of many runs: ``rpud sweep`` and ``rpud fit``."""

from __future__ import annotations

import json
import os
import shlex
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import AT_MOST_ONE, JsonOptions, command
from rpud_sim.cli.output import print_json, progress_bar, table
from rpud_sim.cli.program import ExitCode
from rpud_sim.foundation.options import option, positional, required
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import printable

if TYPE_CHECKING:
    from rpud_sim.studies.fit.fit import Fit, Proof
    from rpud_sim.studies.fit.target_file import FitSpecification

_CAUSES = 3  # inputs of a figure in the table; the page and indices.json have all
_PROCESSES = Quantity("", "processes", 1, 1024, whole=True)
_DRILLS = Quantity("", "synthetic drills", 10, 100_000, whole=True)
_WORKERS = "processes on this machine (default: one for each of its cores)"


@dataclass(frozen=True, kw_only=True)
class _Sweep(JsonOptions):
    spec: str = positional("SPEC", "the sweep, such as config/sweep.yaml")
    out: str = required(
        "folder for tables and a page; finished parts of an earlier call are kept", metavar="DIR"
    )
    workers: int | None = option(None, _WORKERS, _PROCESSES, group=AT_MOST_ONE)
    scheduler: str | None = option(
        None,
        "run on the Dask cluster of this scheduler",
        metavar="tcp://HOST:PORT",
        group=AT_MOST_ONE,
    )


@command(
    "sweep",
    "config/sweep.yaml --out sweeps/first",
    "run a design of experiments over parameters, rocks and faults",
    _Sweep,
)
def _sweep(options: _Sweep) -> int:
    from rpud_sim.studies.sweep.specification_file import read_specification

    started = time.perf_counter()
    specification = read_specification(options.spec)
    from rpud_sim.studies.sweep.sweep import run_sweep

    with progress_bar(" simulations", specification.simulations) as bar:
        result = run_sweep(
            specification,
            Path(options.out),
            _worker_count(options.workers),
            options.scheduler,
            bar.update,
        )
    wall = time.perf_counter() - started
    if options.json:
        print_json(
            {
                "out": str(result.folder),
                **result.manifest,
                "run": result.simulations,
                "kept": result.kept,
                "failures": result.failures,
                "report": str(result.report),
                **({"indices": result.indices} if result.indices else {}),
                "wall_time": wall,
            }
        )
        return ExitCode.DONE
    print(
        f"{specification.point_count} points of {specification.repeat} simulations of "
        f"{specification.duration:g} s: {result.simulations} run, {result.kept} kept, "
        f"{result.failures} failed, in {wall:.1f} s"
    )
    for line in _indices(result.indices):
        print(line)
    names = ["simulations.parquet", "points.parquet", *(["indices.json"] if result.indices else [])]
    for path in (*(result.folder / name for name in names), result.report):
        print(printable(path))
    return ExitCode.DONE


def _indices(indices: Mapping[str, Any]) -> list[str]:
    """Return a table of the figures, with the inputs that cause most of their variance."""
    if not indices:
        return []
    rows = []
    for name, item in indices.items():
        if "missing" in item:
            rows.append((name, item["unit"], "-", "-", "-", "-", item["missing"]))
            continue
        ranked = sorted(item["inputs"].items(), key=lambda each: -each[1]["total"])
        rows.append(
            (
                *(name, item["unit"], f"{item['mean']:.4g}"),
                *(f"{end:.4g}" for end in item["interval_90"]),
                f"{item['noise_share']:.2f}",
                ", ".join(f"{cause} {share['total']:.2f}" for cause, share in ranked[:_CAUSES]),
            )
        )
    head = ("figure", "unit", "mean", "5 %", "95 %", "noise", "greatest shares in all")
    return table(head, rows, 2)


@dataclass(frozen=True, kw_only=True)
class _FitOptions(JsonOptions):
    targets: str = positional("TARGETS", "the fit, such as config/fit_paper_drilling.yaml")
    out: str = required(
        "folder for numbers, parameters and a page; finished runs of an earlier call are kept",
        metavar="DIR",
    )
    workers: int | None = option(None, _WORKERS, _PROCESSES)
    prove: int | None = option(
        None,
        "fit N synthetic drills of known parameters and count the intervals that hold them",
        _DRILLS,
    )


@command(
    "fit",
    "config/fit_paper_drilling.yaml --out fits/drilling",
    "fit parameters, with intervals, to figures or data of a drill",
    _FitOptions,
    "With --prove it fits synthetic drills instead, and counts how many intervals are right.",
)
def _run_fit(options: _FitOptions) -> int:
    from rpud_sim.studies.fit.target_file import read_target_file

    specification = read_target_file(options.targets)
    if options.prove:
        return _prove(options, specification, options.prove)
    return _fit(options, specification)


def _fit(options: _FitOptions, specification: FitSpecification) -> int:
    from rpud_sim.studies.fit.fit import most_simulations, run_fit
    from rpud_sim.studies.fit.fit_report import fit_content, write_fit

    started = time.perf_counter()
    out = Path(options.out)
    with progress_bar(" runs", most_simulations(specification)) as bar:
        fit = run_fit(specification, out, _worker_count(options.workers), bar.update)
    write_fit(fit, out, f"rpud fit {shlex.quote(options.targets)} --out DIR")
    if options.json:
        print_json({"out": str(out), **fit_content(fit), "run": fit.simulations, "kept": fit.kept})
    else:
        print(fit_text(fit))
        wall = time.perf_counter() - started
        where = f"{printable(out)}/report.html"
        print(f"{fit.simulations} runs, {fit.kept} kept, in {wall:.0f} s: {where}")
    return ExitCode.INCOMPLETE if fit.refusal else ExitCode.DONE


def _prove(options: _FitOptions, specification: FitSpecification, drills: int) -> int:
    from rpud_sim.studies.fit.fit import proof_simulations, prove
    from rpud_sim.studies.fit.rounds import FitFolder
    from rpud_sim.studies.store import write_whole

    out = Path(options.out)
    with progress_bar(" runs", proof_simulations(specification, drills) + drills) as bar:
        folder = FitFolder(out, specification, _worker_count(options.workers), bar.update)
        with folder.held():
            proof = prove(folder, specification, drills, bar.update)
            content = json.dumps(proof.content(), indent=1)
            write_whole(out / "proof.json", f"{content}\n")
    print_json(proof.content()) if options.json else print(_proof_text(proof))
    return ExitCode.DONE if proof.holds else ExitCode.FAILED


def fit_text(fit: Fit) -> str:
    """Return what a fit found, for a terminal."""
    lines = []
    if fit.missed:
        lines.append(f"not met: {fit.refusal}; there are no intervals")
        lines += [item.miss for item in fit.missed]
        lines.append("nearest point:")
    elif fit.refusal:
        lines.append(f"no intervals: {fit.refusal}")
    lines += [_unknown(fit, name) for name in fit.specification.unknowns]
    lines += [f"{choices}: probability {share:.3f}" for choices, share in fit.choices]
    lines += [f"ridge: {ridge}" for ridge in (fit.found.ridges if fit.found else ())]
    lines += map(str, fit.comparisons)
    lines.append(f"misfit {fit.misfit_text}")
    return "\n".join(lines)


def _unknown(fit: Fit, name: str) -> str:
    from rpud_sim.studies.sweep.specification import unit_of

    if fit.found is None:
        return f"{name:28} {fit.best[name]:.4g} {unit_of(name)}".rstrip()
    interval = fit.found.intervals[name]
    best = f"{fit.best[name]:.{interval.digits}g}"
    text = f"{name:28} {best:10} {interval} {unit_of(name)}".rstrip()
    return text + "".join(f" ({remark})" for remark in interval.remarks)


def _proof_text(proof: Proof) -> str:
    content = proof.content()
    lines = []
    for name, found in content["covered"].items():
        low, high = found["interval"]
        lines.append(
            f"{name:28} {found['count']} of {proof.drills} intervals hold the true value: "
            f"{100 * found['share']:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"
        )
    verdict = "within" if proof.holds else "outside"
    lines.append(
        f"{100 * content['level']:g} % is {verdict} what chance allows; {proof.refused} synthetic "
        "drills have no intervals"
    )
    return "\n".join(lines)


def _worker_count(given: int | None) -> int:
    """Return how many processes work; by default one for each core that this process may use."""
    return given or len(os.sched_getaffinity(0))
