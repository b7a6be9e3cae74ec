"""Compilation of the kernels: cached, without the GIL, in strict IEEE arithmetic."""

import contextlib
from pathlib import Path

import numba


def _drop_stale_cache() -> None:
    """Remove cached kernels of the package that are older than any source of the model.

    Numba compares a cached kernel with the file it is written in, but not with the files of the
    kernels that it calls. A kernel of the simulation calls those of the model: kept, it would go on
    with the former equations.
    """
    model = Path(__file__).parent
    newest = max(source.stat().st_mtime_ns for source in model.glob("*.py"))
    for index in model.parent.glob("*/__pycache__/*.nbi"):
        with contextlib.suppress(OSError):
            if index.stat().st_mtime_ns < newest:
                index.unlink()


_drop_stale_cache()

# No fastmath: the same commands must give the same bits, in one call or in many.
compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
