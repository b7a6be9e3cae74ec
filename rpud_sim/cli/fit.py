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
    from rpud_sim.studies.fit.fit import Fit
    from rpud_sim.studies.fit.proof import Proof
    from rpud_sim.studies.fit.specification import Specification

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
    from rpud_sim.studies.fit.branches import FitError
    from rpud_sim.studies.fit.target_file import read_target_file
    from rpud_sim.studies.processes import WorkerError

    with failing(FitError, WorkerError):
        specification = read_target_file(arguments.targets)
        return (_prove if arguments.prove else _fit)(arguments, specification)


def _fit(arguments: argparse.Namespace, specification: Specification) -> int:
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
        return ExitCode.DONE
    print(_text(fit))
    wall = time.perf_counter() - started
    print(f"{fit.simulations} runs, {fit.kept} kept, in {wall:.0f} s: {printable(out)}/report.html")
    return ExitCode.DONE


def _prove(arguments: argparse.Namespace, specification: Specification) -> int:
    from rpud_sim.studies.fit.folder import FitFolder
    from rpud_sim.studies.fit.proof import proof_simulations, prove

    drills = arguments.prove
    out = Path(arguments.out)
    with progress_bar(" runs", proof_simulations(specification, drills) + drills) as bar:
        folder = FitFolder(out, specification, worker_count(arguments), bar.update)
        with folder.held():
            proof = prove(folder, specification, drills, bar.update)
            content = json.dumps(proof.content(), indent=1)
            folder.write(_PROOF, f"{content}\n".encode())
    print_json(proof.content()) if arguments.json else print(_proof_text(proof))
    return ExitCode.DONE if proof.holds else ExitCode.FAILED


def _text(fit: Fit) -> str:
    from rpud_sim.studies.fit.specification import unit_of

    lines = []
    for name, interval in fit.identifiability.intervals.items():
        lines.append(
            f"{name:28} {fit.best[name]:<10.4g} {interval.low:.4g} to {interval.high:.4g} "
            f"{unit_of(name)}".rstrip()
            + ("" if interval.identified == "yes" else f" (identified: {interval.identified})")
        )
    for choices, share in fit.probabilities:
        if choices:
            words = ", ".join(f"{name} {value}" for name, value in choices.items())
            lines.append(f"{words}: probability {share:.3f}")
    lines += [str(ridge) for ridge in fit.identifiability.ridges]
    for item in fit.comparisons:
        held = " (held out)" if item.target.hold_out else ""
        lines.append(
            f"{item.target.title}: {item.target.value:.4g} {item.target.measure.unit}".rstrip()
            + f", model {item.mean:.4g}, ratio {item.ratio:.3f}{held}"
        )
    hold_out = fit.misfit(True)
    lines.append(
        f"misfit {fit.misfit(False):.2f} standard deviations"
        + ("" if hold_out is None else f", held out {hold_out:.2f}")
    )
    if not fit.reached:
        lines.append("the model does not reach every target: the intervals assume that it can")
    return "\n".join(lines)


def _proof_text(proof: Proof) -> str:
    lines = [
        f"{name:28} {100 * share:.1f} % of the 90 % intervals hold the true value"
        for name, share in proof.covered.items()
    ]
    low, high = (f"{100 * share:.0f}" for share in proof.content()["range"])
    verdict = "within" if proof.holds else "outside"
    lines.append(
        f"{proof.drills} synthetic drills, together {100 * proof.mean:.1f} %: "
        f"{verdict} {low} to {high} %"
    )
    return "\n".join(lines)
