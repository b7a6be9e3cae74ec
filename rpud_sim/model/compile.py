"""Compilation of the kernels: kept in files, without the GIL, in strict IEEE arithmetic."""

from pathlib import Path
from typing import Any

import numpy as np
from numba.core import config

from rpud_sim.kernels.dispatchers import kernel_compiler
from rpud_sim.kernels.processor import notice, this_target
from rpud_sim.kernels.store import KernelStore, user_folders

# Beside the package, so that an installation has its kernels for every user. Where that folder
# cannot be written, each user keeps what was compiled.
STORE = KernelStore((Path(__file__).parents[1] / "kernels" / "compiled", *user_folders()))

compiled = kernel_compiler(STORE, Path(__file__).parent)


def record_type(fields: list[Any]) -> np.dtype[Any]:
    """Return the type of records that kernels read by attributes, such as ``state.seconds``."""
    plain = np.dtype(fields, align=True)
    # Numba reads them so; in Python, with NUMBA_DISABLE_JIT, it takes records of this class.
    return np.dtype((np.record, plain)) if config.DISABLE_JIT else plain


def compilation_notice() -> str:
    """Return the line that says why the model is compiled, and where the kernels are kept."""
    return notice(this_target(), STORE)
