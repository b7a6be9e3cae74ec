"""``rpud fit``: parameters with intervals, from figures or data of somebody's drill."""

from __future__ import annotations

import argparse
import json
import shlex
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rpud_sim.cli.options import Number, add_json_argument, add_workers_argument, worker_count
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import printable

if TYPE_CHECKING:
    from rpud_sim.studies.fit.fit import Fit, Proof
    from rpud_sim.studies.fit.target_file import FitSpecification

HELP = "fit parameters, with intervals, to figures or data of a drill"
EXAMPLE = "rpud fit config/fit_paper_drilling.yaml --out fits/drilling"
DETAILS = "With --prove it fits synthetic drills instead, and counts how many intervals are right."

_DRILLS = Quantity("", "synthetic drills", 10, 100_000, whole=True)
_PROOF = "proof.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "targets", metavar="TARGETS", help="the fit, such as config/fit_paper_drilling.yaml"
    )
    parser.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder for numbers, parameters and a page; finished runs of an earlier call are kept",
    )
    add_workers_argument(parser)
    parser.add_argument(
        "--prove",
        action=Number,
        quantity=_DRILLS,
        metavar="N",
        help="fit N synthetic drills of known parameters and count the intervals that hold them",
    )
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.studies.fit.rounds import FitError
    from rpud_sim.studies.fit.target_file import read_target_file
    from rpud_sim.studies.workers import WorkerError

    with failing(FitError, WorkerError):
        specification = read_target_file(arguments.targets)
        return (_prove if arguments.prove else _fit)(arguments, specification)


def _fit(arguments: argparse.Namespace, specification: FitSpecification) -> int:
    from rpud_sim.studies.fit.fit import most_simulations, run_fit
    from rpud_sim.studies.fit.fit_report import fit_content, write_fit

    started = time.perf_counter()
    out = Path(arguments.out)
    with progress_bar(" runs", most_simulations(specification)) as bar:
        fit = run_fit(specification, out, worker_count(arguments), bar.update)
    command = f"rpud fit {shlex.quote(arguments.targets)} --out DIR"
    write_fit(fit, out, command)
    if arguments.json:
        print_json({"out": str(out), **fit_content(fit), "run": fit.simulations, "kept": fit.kept})
    else:
        print(fit_text(fit))
        wall = time.perf_counter() - started
        where = f"{printable(out)}/report.html"
        print(f"{fit.simulations} runs, {fit.kept} kept, in {wall:.0f} s: {where}")
    return ExitCode.INCOMPLETE if fit.refusal else ExitCode.DONE


def _prove(arguments: argparse.Namespace, specification: FitSpecification) -> int:
    from rpud_sim.studies.fit.fit import proof_simulations, prove
    from rpud_sim.studies.fit.rounds import FitFolder
    from rpud_sim.studies.store import write_whole

    drills = arguments.prove
    out = Path(arguments.out)
    with progress_bar(" runs", proof_simulations(specification, drills) + drills) as bar:
        folder = FitFolder(out, specification, worker_count(arguments), bar.update)
        with folder.held():
            proof = prove(folder, specification, drills, bar.update)
            content = json.dumps(proof.content(), indent=1)
            write_whole(out / _PROOF, f"{content}\n")
    print_json(proof.content()) if arguments.json else print(_proof_text(proof))
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
    from rpud_sim.studies.fit.target_file import unit_of

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
