"""Machine code of the kernels for this processor: each operation rounds, and no library rounds."""

import json
import subprocess
import sys

import pytest

pytestmark = pytest.mark.extended

# Compiles every kernel for the processor of this machine instead of the baseline; reads no file and
# writes none. Prints the functions that each one calls, and its fused operations.
PROGRAM = r"""
import json, re
import llvmlite.binding as llvm
from numba.core.codegen import get_host_cpu_features
from rpud_sim.kernels import dispatchers
from rpud_sim.kernels.store import Target

target = Target(llvm.get_host_cpu_name(), get_host_cpu_features())
found = {}

class Files(dispatchers._Files):
    def load_overload(self, sig, target_context):
        return None

    def save_overload(self, sig, data):
        code, machine_code = data.library.get_llvm_str(), data.library.get_asm_str()
        # Of several numbers at once it is what it is of one.
        code = re.sub(r"\.v\d+f64", ".f64", code)
        called = set(re.findall(r'^declare [^@]*@"?([^"( ]+)', code, re.M))
        fused = set(re.findall(r"\bv?fn?m(?:add|sub|la|ls)\w*", machine_code))
        loose = set(re.findall(r"\bf(?:add|sub|mul|div) (?:fast|contract|reassoc|arcp)", code))
        found[self._function] = sorted(called), sorted(fused | loose)

dispatchers._Files = Files
dispatchers.this_target = lambda: target
from toolchain.precompile import use_every_kernel

use_every_kernel()
print(json.dumps(found))
"""
# What is exact or rounded once; sqrt is the library's name of the processor's instruction.
EXACT = {
    *("sqrt", "numba_frexp", "llvm.sqrt.f64", "llvm.floor.f64", "llvm.ceil.f64", "llvm.rint.f64"),
    *("llvm.fabs.f64", "llvm.copysign.f64", "llvm.is.fpclass.f64"),
}
# What computes nothing: Numba's and Python's own, memory and integers.
INTEGERS = ("llvm.smax", "llvm.smin", "llvm.umin")
SERVICES = ("numba_", "Py", "_Py", "llvm.mem", "llvm.lifetime", *INTEGERS, "_ZN")


@pytest.fixture(scope="module")
def kernels():
    done = subprocess.run([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def test_kernels_call_nothing_that_rounds(kernels):
    assert "rpud_sim.model.events.advance" in kernels
    found = {
        name: other
        for name, (called, _) in kernels.items()
        if (other := [c for c in called if c not in EXACT and not c.startswith(SERVICES)])
    }
    assert found == {}


def test_kernels_fuse_no_operations(kernels):
    assert {name: fused for name, (_, fused) in kernels.items() if fused} == {}
