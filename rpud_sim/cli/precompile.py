"""Step of the set-up that compiles every kernel, so that no later start has to."""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rpud_sim.cli.options import Parser
from rpud_sim.cli.program import CommandError, ExitCode, report_errors, run_program

if TYPE_CHECKING:
    from rpud_sim.kernels.store import KernelStore

_PROGRAM = "python -m rpud_sim.cli.precompile"


def main(words: Sequence[str] | None = None) -> None:
    text = "Compile the kernels of the model that are not there yet, for any x86-64-v3 processor."
    parser = Parser(prog=_PROGRAM, description=text)
    text = "folder for all kernels (default: that of this installation, or the user's)"
    parser.add_argument("--into", metavar="DIR", help=text)
    arguments = parser.parse_args(words)
    run_program(_PROGRAM, lambda: report_errors(_PROGRAM, lambda: run(arguments)))


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.kernels.store import BASELINE, this_target
    from rpud_sim.model.compile import STORE

    target = this_target()
    if arguments.into:
        if target.lacking:
            lacking = ", ".join(target.lacking)
            raise CommandError(f"this processor lacks {lacking} of {BASELINE}: --into needs them")
        STORE.folders = (Path(arguments.into), *STORE.folders)
    if arguments.into and STORE.place() != STORE.folders[0]:
        raise CommandError(STORE.refused or f"nothing can be written to {arguments.into}")
    began = time.perf_counter()
    _use_every_kernel()
    if STORE.lost:
        folders = ", ".join(str(folder) for folder in STORE.folders)
        raise CommandError(f"nothing can be written to {folders}")
    for number, file in enumerate(STORE.found) if arguments.into else ():
        if file.parent != STORE.folders[0]:
            STORE.folders[0].mkdir(parents=True, exist_ok=True)
            STORE.found[number] = Path(shutil.copyfile(file, STORE.folders[0] / file.name))
    print(_text(STORE, target.cpu, time.perf_counter() - began))
    return ExitCode.DONE


def _use_every_kernel() -> None:
    """Call each kernel once, because a kernel is compiled when it is first called."""
    from rpud_sim.simulation.configuration import Configuration
    from rpud_sim.simulation.ensemble import compile_kernels

    configuration = Configuration()
    actuator = dataclasses.replace(configuration.actuator, actuator_model="resonance")
    compile_kernels(configuration, messages=True)
    compile_kernels(dataclasses.replace(configuration, actuator=actuator))


def _text(store: KernelStore, cpu: str, duration: float) -> str:
    files = (*store.found, *store.written)
    place = ", ".join(sorted({str(file.parent) for file in files}))
    done = (
        f"{len(store.written)} compiled in {duration:.0f} s" if store.written else "none to compile"
    )
    return f"{done}: {len(files)} kernels for {cpu} are in {place}"


if __name__ == "__main__":
    main()
