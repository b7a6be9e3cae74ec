"""Compilation of the kernels: kept in files, without the GIL, in strict IEEE arithmetic."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import config, event

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


_LONG = 1.0  # time of compiling after which it is reported [s]


class _CompilationListener(event.Listener):
    """Listener of Numba that starts a timer when the first kernel is compiled, not loaded."""

    def __init__(self, notice: threading.Timer) -> None:
        self._notice = notice

    def on_start(self, event: event.Event) -> None:
        """Numba begins to compile."""
        if self._notice.ident is None:
            self._notice.start()

    def on_end(self, event: event.Event) -> None:
        """Numba has compiled."""


@contextmanager
def compilation_reported(report: Callable[[str], object]) -> Iterator[None]:
    """Context that reports, from another thread, that kernels are compiled and it takes long."""
    timer = threading.Timer(_LONG, lambda: report(compilation_notice()))
    try:
        with event.install_listener("numba:compile", _CompilationListener(timer)):
            yield
    finally:
        timer.cancel()
