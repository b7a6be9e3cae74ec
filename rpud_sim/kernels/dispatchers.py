"""Compilation of kernels with Numba: one piece of machine code for all that a kernel calls.

Numba compiles each called function to separate machine code, once for each combination of types
and literals, links it into the caller and optimises it again. Here the rules that a kernel calls
are only lowered to intermediate code, once for all integers, and optimised in the kernel. That
takes a third of the time and gives the same bits.

The target processor is ours alone: other Numba code in the same process is compiled as always.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from llvmlite.binding import Linkage
from numba.core import config, types
from numba.core.caching import _Cache
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import Compiler, compile_result
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from rpud_sim.kernels.store import KernelStore, digest_of_sources, kernel_name, this_target

# No fastmath: the same commands must give the same bits, in one call or in many. Kernels make no
# arrays, so that references to the caller's arrays need not be counted.
_OPTIONS = {"nopython": True, "nogil": True, "error_model": "numpy", "_nrt": False}

# Parts of the mangled names of rules that are compiled into their callers: small ones, whose calls
# take as long as they do, and those with the drill's constants as arguments.
_INLINED = (
    *("10elementary", "5model5steps", "11closed_form", "7segment"),
    *("7collide", "15common_velocity", "10pass_event", "12open_segment"),
)


class _KernelLibrary(JITCodeLibrary):
    """Machine code of a kernel, the only one that calls its copies of the rules."""

    def _optimize_final_module(self) -> None:
        # Numba shares the functions that it links; LLVM must then keep them and their calls. As
        # the kernel's own they are inlined where they are called once, and passed in registers.
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.linkonce_odr:
                function.linkage = Linkage.internal
                if any(room in function.name for room in _INLINED):
                    function.add_function_attribute("alwaysinline")
        super()._optimize_final_module()


class _Codegen(JITCPUCodegen):
    """Machine code for the target instead of the processor of this machine."""

    _library_class = _KernelLibrary

    def _get_host_cpu_name(self) -> str:
        return this_target().cpu

    def _customize_tm_features(self) -> str:
        return this_target().features


@functools.cache
def _codegen() -> _Codegen:
    return _Codegen("rpud_sim.kernels")


class _RuleLibrary(JITCodeLibrary):
    """Intermediate code to link into kernels; never separate machine code."""

    # Numba sets the environment of loaded code here; a rule's is part of the kernel's code.
    codegen = SimpleNamespace(set_env=lambda name, environment: None)

    def _optimize_final_module(self) -> None:
        """Leave it to the kernel."""

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return zero, Numba's word for a function without machine code."""
        return 0


class _RuleCompiler(Compiler):
    def compile_extra(self, func: Callable[..., Any]) -> Any:
        self.state.library = _RuleLibrary(_codegen(), func.__qualname__)
        return super().compile_extra(func)


class _KernelCompiler(Compiler):
    def compile_extra(self, func: Callable[..., Any]) -> Any:
        library = _codegen().create_library(func.__qualname__)
        library.enable_object_caching()
        self.state.library = library
        return super().compile_extra(func)


class _Rule(CPUDispatcher):
    """What a kernel calls. Every integer is taken as int64, whether it is a literal or a byte."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        wide = [_widen(kind) for kind in args]
        return super().get_call_template(wide, {name: _widen(kind) for name, kind in kws.items()})


def _widen(kind: Any) -> Any:
    kind = types.unliteral(kind)
    narrow = isinstance(kind, types.Integer) and kind.bitwidth < 64
    return types.int64 if narrow else kind


class KernelDispatcher(CPUDispatcher):
    """A kernel for Numba: machine code for Python, and a rule for the kernels that call it."""

    def __init__(
        self, py_func: Callable[..., Any], store: KernelStore, sources: tuple[Path, ...]
    ) -> None:
        super().__init__(py_func, targetoptions=_OPTIONS, pipeline_class=_KernelCompiler)
        self._cache = _Files(f"{py_func.__module__}.{py_func.__qualname__}", store, sources)

    @functools.cached_property
    def _rule(self) -> _Rule:  # only when a caller is compiled: hundreds would slow every start
        inner = {**_OPTIONS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        return _Rule(self.py_func, targetoptions=inner, pipeline_class=_RuleCompiler)

    @property
    def _numba_type_(self) -> Any:
        """Type of the kernel where another one calls it."""
        return types.Dispatcher(self._rule)

    def add_overload(self, cres: Any) -> None:
        """Make a compiled or loaded result known, with the environments of its rules."""
        super().add_overload(cres)
        for environment in cres.referenced_envs or cres._find_referenced_environments():
            _codegen().set_env(environment.env_name, environment)


class _Files(_Cache):
    def __init__(self, function: str, store: KernelStore, sources: tuple[Path, ...]) -> None:
        self._function = function
        self._store = store
        self._sources = sources

    cache_path = None

    def _name(self, signature: object) -> str:
        options = repr((_codegen().magic_tuple(), str(config.OPT), sorted(_OPTIONS.items())))
        sources = digest_of_sources(self._sources)
        return kernel_name(self._function, str(signature), this_target().cpu, options, sources)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel from its file; None if there is none."""
        content = self._store.read(name := self._name(sig))
        try:
            return None if content is None else _load(content, target_context)
        except Exception as error:  # the digest shows that it is complete, not that it is a kernel
            self._store.reject(name, error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the compiled kernel to its file."""
        self._store.write(self._name(sig), dumps(_content(data)))

    def enable(self) -> None:
        """Files are always in use, and dropped when their successors are written."""

    disable = flush = enable


def _content(result: Any) -> tuple[Any, ...]:
    """Return what a file keeps of a kernel: like Numba, but without its intermediate code."""
    _, _, (machine_code, _) = result.library.serialize_using_object_code()
    descriptor = result.fndesc
    descriptor.typemap = descriptor.calltypes = None
    others = tuple(result._find_referenced_environments())
    return machine_code, descriptor, result.environment, result.signature, others


def _load(content: Any, target_context: Any) -> Any:
    machine_code, descriptor, environment, signature, others = content
    # Defines the functions that machine code refers to: without it the process dies. What Numba
    # sets up for a compilation beyond that takes a quarter of a start.
    rtsys.initialize(target_context)
    codegen = _codegen()
    library = codegen.create_library(descriptor.qualname)
    library.enable_object_caching()
    library._set_compiled_object(machine_code)
    library._finalize_final_module()
    codegen._engine._defined_symbols.add(descriptor.llvm_cpython_wrapper_name)
    return compile_result(
        typing_context=target_context.typing_context,
        target_context=target_context,
        entry_point=target_context.get_executable(library, descriptor, environment),
        signature=signature,
        objectmode=False,
        lifted=(),
        fndesc=descriptor,
        library=library,
        environment=environment,
        reload_init=(),
        referenced_envs=others,
    )
