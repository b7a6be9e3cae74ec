"""Compilation of the kernels: stored in files, without the GIL, in strict IEEE arithmetic."""

import struct
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.kernels.kernel import Kernel, is_disabled, kernel_compiler
from rpud_sim.kernels.store import KernelStore, notice, this_target, user_folders

# Beside the package, so that an installation has its kernels for every user. Where that folder
# cannot be written, each user keeps what was compiled.
STORE = KernelStore((Path(__file__).parents[1] / "kernels" / "compiled", *user_folders()))

compiled = kernel_compiler(STORE, Path(__file__).parent)


def record_type(fields: list[Any]) -> np.dtype[Any]:
    """Return the type of records that kernels read by attributes, such as ``state.seconds``."""
    plain = np.dtype(fields, align=True)
    # Numba reads them so; in Python, with NUMBA_DISABLE_JIT, it takes records of this class.
    return np.dtype((np.record, plain)) if is_disabled() else plain


def floats(*names: str) -> list[Any]:
    """Return fields of a record that are numbers of double precision."""
    return [(name, np.float64) for name in names]


def compilation_notice() -> str:
    """Return the line that explains why the model is compiled, and where the kernels are stored."""
    return notice(this_target(), STORE)


_LONG = 1.0  # time of compiling after which it is reported [s]


@contextmanager
def compilation_reported(report: Callable[[str], object]) -> Iterator[None]:
    """Context that reports, from another thread, that kernels are compiled and it takes long."""
    from numba.core import event

    timer = threading.Timer(_LONG, lambda: report(compilation_notice()))

    class Listener(event.Listener):
        """Starts the timer when the first kernel is compiled, not loaded."""

        def on_start(self, event: event.Event) -> None:
            if timer.ident is None:
                timer.start()

        def on_end(self, event: event.Event) -> None:
            """Numba has compiled."""

    try:
        with event.install_listener("numba:compile", Listener()):
            yield
    finally:
        timer.cancel()


# Of a field in a record's bytes. NumPy builds an object for the record and one for each field,
# which takes many times as long.
_CODES = {"f8": "d", "i8": "q"}


def reader_of(dtype: np.dtype[Any], *names: str) -> Callable[[np.ndarray], tuple[Any, ...]]:
    """Return a function that reads fields of 64 bits of the first record of an array.

    ``names`` are in the order in which the dtype has them.
    """
    layout, end = "=", 0
    fields: Mapping[str, Any] = dtype.fields or {}
    for name in names:
        kind, offset = fields[name][:2]
        layout += f"{offset - end}x{_CODES[kind.str[1:]]}"
        end = offset + kind.itemsize
    read: Any = struct.Struct(layout).unpack_from  # takes arrays as buffers
    return read


_machine_codes: dict[Any, Callable[..., Any]] = {}


def machine_code(kernel: Any, *examples: object) -> Callable[..., Any]:
    """Return a kernel as it is compiled for the types of the first examples; it takes no others.

    The kernel itself looks at the type of each argument, for longer than a millisecond's motion
    takes. To find the types of examples takes as long as a second of motion.
    """
    if kernel not in _machine_codes:
        code: Callable[..., Any] = kernel
        if isinstance(kernel, Kernel):  # not with NUMBA_DISABLE_JIT
            from numba import typeof

            code = kernel.dispatcher.compile(tuple(map(typeof, examples)))
        _machine_codes[kernel] = code
    return _machine_codes[kernel]
