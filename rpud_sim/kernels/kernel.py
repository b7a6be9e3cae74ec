"""Functions that Numba compiles when they are first called, and that import it only then."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.kernels.store import KernelStore

if TYPE_CHECKING:
    from rpud_sim.kernels.dispatchers import KernelDispatcher


class Kernel:
    """A function that is compiled, or loaded from its file, when it is first called."""

    def __init__(
        self, function: Callable[..., Any], store: KernelStore, sources: tuple[Path, ...]
    ) -> None:
        functools.update_wrapper(self, function)
        self._made_from = function, store, sources

    @functools.cached_property
    def dispatcher(self) -> KernelDispatcher:
        """What Numba compiles and calls."""
        from rpud_sim.kernels.dispatchers import KernelDispatcher

        return KernelDispatcher(*self._made_from)

    def __call__(self, *arguments: Any) -> Any:
        return self.dispatcher(*arguments)

    @property
    def _numba_type_(self) -> Any:
        return self.dispatcher._numba_type_


def kernel_compiler(store: KernelStore, package: Path) -> Callable[[Callable[..., Any]], Any]:
    """Return the decorator of functions that are compiled when they are first called.

    Every kernel comes from the sources in the folder ``package``, and from its own file.
    """
    own = tuple(sorted(Path(__file__).parent.glob("*.py")))
    shared = tuple(sorted(package.resolve().glob("*.py")))

    def compiled(function: Callable[..., Any]) -> Any:
        if is_disabled():
            return function
        # Bytecode that pytest keeps has the path by which the file was imported first.
        file = Path(function.__globals__["__file__"]).resolve()
        return Kernel(function, store, (*own, *shared, *(() if file in shared else (file,))))

    return compiled


@functools.cache
def is_disabled() -> bool:
    """Whether kernels run as Python, by NUMBA_DISABLE_JIT or a file of Numba's settings."""
    if "numba" in sys.modules or Path(".numba_config.yaml").exists():
        from numba.core import config

        return bool(config.DISABLE_JIT)
    try:
        return int(os.environ.get("NUMBA_DISABLE_JIT", "0")) != 0
    except ValueError:  # Numba warns, and ignores it
        return False
