"""Compile every kernel of the model, so that no later start has to: `make setup`, `make dist`."""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import sys
from pathlib import Path

from rpud_sim.kernels.store import BASELINE, this_target
from rpud_sim.model.compile import STORE
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.ensemble import compile_kernels


def use_every_kernel() -> None:
    """Call each kernel once, because a kernel is compiled when it is first called."""
    configuration = Configuration()
    actuator = dataclasses.replace(configuration.actuator, actuator_model="resonance")
    compile_kernels(configuration, messages=True)
    compile_kernels(dataclasses.replace(configuration, actuator=actuator))


def main() -> None:
    """Compile into the store's folder, or gather all kernels in the folder of `--into`."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--into", metavar="DIR", type=Path, help="folder for all kernels")
    if into := parser.parse_args().into:
        if lacking := ", ".join(this_target().lacking):
            sys.exit(f"precompile: this processor lacks {lacking} of {BASELINE}")
        into.mkdir(parents=True, exist_ok=True)
        STORE.folders = (into, *STORE.folders)
    use_every_kernel()
    if STORE.lost or (into and STORE.place() != into):
        sys.exit(f"precompile: nothing can be written to {', '.join(map(str, STORE.folders))}")
    files = {*STORE.found, *STORE.written}
    if into:
        files = {Path(shutil.copy(each, into)) if each.parent != into else each for each in files}
    places = ", ".join(sorted({str(each.parent) for each in files}))
    print(f"{len(STORE.written)} compiled: {len(files)} kernels are in {places}")


if __name__ == "__main__":
    main()
