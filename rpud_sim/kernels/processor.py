"""The processor that kernels are compiled for: a baseline that most machines have, or this one."""

from __future__ import annotations

import dataclasses
import functools
import platform

import llvmlite.binding as llvm
import numba
from numba.core import config
from numba.core.codegen import get_host_cpu_features

from rpud_sim.kernels.store import KernelStore

# Level of the x86-64 psABI that Intel has since Haswell (2013) and AMD since Excavator (2015). The
# kernels fuse nothing. Those of level 2 are 4 to 7 % slower: their instructions overwrite an
# operand.
BASELINE = "x86-64-v3"

# What the level adds to plain x86-64, by LLVM's names.
BASELINE_FEATURES = frozenset(
    (
        *("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"),
        *("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
    )
)


@dataclasses.dataclass(frozen=True)
class Target:
    """Processor that kernels are compiled for."""

    cpu: str  # name, as LLVM knows it
    features: str = ""  # instructions beyond those of the name, as LLVM writes them
    # what this processor lacks of the baseline; empty if the target is the baseline
    lacking: tuple[str, ...] = ()


def choose_target(cpu: str, features: str) -> Target:
    """Return the baseline if a processor's features (``+ssse3,-avx``) have it, otherwise itself."""
    present = {name[1:] for name in features.split(",") if name.startswith("+")}
    lacking = tuple(sorted(BASELINE_FEATURES - present))
    return Target(cpu, features, lacking) if lacking else Target(BASELINE)


@functools.cache
def this_target() -> Target:
    """Return the target on this machine; NUMBA_CPU_NAME and NUMBA_CPU_FEATURES stand in for it."""
    features = config.CPU_FEATURES
    if features is None:
        features = get_host_cpu_features()
    return choose_target(config.CPU_NAME or llvm.get_host_cpu_name(), features)


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
