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
    parser = Parser(
        prog=_PROGRAM,
        description="Compile the model now, for the first start on this machine or on others. "
        "The kernels serve every x86-64 processor of level x86-64-v3 with the same versions of "
        "Python (3.x), NumPy (its first number), Numba and llvmlite. Kernels that are there "
        "already are left.",
    )
    parser.add_argument(
        "--into",
        metavar="DIR",
        help="folder for the kernels, such as rpud_sim/kernels/compiled of a package that is built "
        "(default: that of this installation, or the user's if it cannot be written to)",
    )
    arguments = parser.parse_args(words)
    run_program(_PROGRAM, lambda: report_errors(_PROGRAM, lambda: run(arguments)))


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.kernels.processor import BASELINE, this_target
    from rpud_sim.model.compile import STORE

    target = this_target()
    if arguments.into:
        if target.lacking:
            lacking = ", ".join(target.lacking)
            raise CommandError(f"this processor lacks {lacking} of {BASELINE}: --into needs them")
        STORE.folders = (Path(arguments.into), *STORE.folders)
    place = STORE.place()
    if arguments.into and place != STORE.folders[0]:
        raise CommandError(STORE.refused or f"nothing can be written to {arguments.into}")
    began = time.perf_counter()
    _use_every_kernel()
    if STORE.lost:
        folders = ", ".join(str(folder) for folder in STORE.folders)
        raise CommandError(f"nothing can be written to {folders}")
    if arguments.into:
        _gather(STORE, Path(arguments.into))
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


def _gather(store: KernelStore, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number, file in enumerate(store.found):
        if file.parent != folder:
            store.found[number] = Path(shutil.copyfile(file, folder / file.name))


def _text(store: KernelStore, cpu: str, duration: float) -> str:
    folders = sorted({str(file.parent) for file in (*store.found, *store.written)})
    place = ", ".join(folders)
    if not store.written:
        return f"nothing to compile: {len(store.found)} kernels for {cpu} are in {place}"
    size = sum(file.stat().st_size for file in store.written) / 1e6
    return (
        f"{len(store.written)} kernels compiled for {cpu} in {duration:.0f} s, {size:.1f} MB; "
        f"{len(store.found) + len(store.written)} are in {place}"
    )


if __name__ == "__main__":
    main()
