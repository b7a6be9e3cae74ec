"""How the model's kernels are compiled: cached, without the GIL, in strict IEEE arithmetic."""

import numba

# No fastmath: the same commands must give the same bits, in one call or in many.
compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
