"""How the model's kernels are compiled: cached, without the GIL, in strict IEEE arithmetic."""

import contextlib
from pathlib import Path

import numba


def _drop_stale_cache() -> None:
    """Remove cached kernels that are older than any source of the model.

    Numba compares a cached kernel with the file it is written in, but not with those of the
    kernels that it calls.
    """
    folder = Path(__file__).parent
    newest = max(source.stat().st_mtime_ns for source in folder.glob("*.py"))
    for index in folder.glob("__pycache__/*.nbi"):
        with contextlib.suppress(OSError):
            if index.stat().st_mtime_ns < newest:
                index.unlink()


_drop_stale_cache()

# No fastmath: the same commands must give the same bits, in one call or in many.
compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
