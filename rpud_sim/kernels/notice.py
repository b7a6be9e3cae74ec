"""The line that says why kernels are compiled, and what becomes of them."""

from __future__ import annotations

import platform

import numba

from rpud_sim.kernels.processor import BASELINE, Target
from rpud_sim.kernels.store import KernelStore


def notice(target: Target, store: KernelStore) -> str:
    """Return the line for a process that has to compile kernels."""
    place = store.place()
    if store.refused:
        cause = store.refused
    elif target.lacking:
        lacking = ", ".join(target.lacking)
        cause = f"this processor lacks {lacking}, which the installed kernels ({BASELINE}) need"
    else:
        versions = f"Python {platform.python_version()}, Numba {numba.__version__}, {target.cpu}"
        cause = f"no compiled kernels for these sources and {versions} were found"
    if place is not None:
        fate = f"they are kept in {place}"
    else:
        folders = " nor ".join(str(folder) for folder in store.folders)
        fate = f"they cannot be kept, because nothing can be written to {folders}"
    return f"compiling the model takes some ten seconds: {cause}; {fate}"
