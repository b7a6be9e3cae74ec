"""Kernels in files: found by whoever has the same sources, and never by anybody else.

Each test compiles a package of two functions in processes of its own.
"""

import os
import pickle
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import rpud_sim
from rpud_sim.kernels.store import KernelStore

pytestmark = pytest.mark.extended

ROOT = Path(rpud_sim.__file__).parents[1]
RULES = """
from store import compiled
FACTOR = 3.0

@compiled
def rule(x, count):
    return FACTOR * x + count
"""
KERNEL = """
import numpy as np
from store import compiled
from room.rules import rule

@compiled
def kernel(values):
    total = 0.0
    for i in range(len(values)):
        total += rule(values[i], 7) + rule(values[i], np.uint8(i))
    return total
"""
STORE = """
import os
from pathlib import Path
from rpud_sim.kernels.kernel import kernel_compiler
from rpud_sim.kernels.store import KernelStore

here = Path(__file__).parent
folders = (here / "kernels", Path(os.environ["OWN"]))
compiled = kernel_compiler(KernelStore(folders), here / "room")
"""
# Prints the result, the functions that were compiled, and how many rules were.
MAIN = """
import numpy as np
from numba.core import event
from room.kernel import kernel
from room.rules import rule

with event.install_recorder("numba:compile") as recorder:
    result = kernel(np.array([1.0, 2.0]))
started = [entry for _, entry in recorder.buffer if entry.is_start]
names = [entry.data["dispatcher"].__name__ for entry in started]
print(result, sorted(name for name in names if name in ("kernel", "rule")))
"""


@pytest.fixture
def package(tmp_path):
    room = tmp_path / "package" / "room"
    room.mkdir(parents=True)
    (room / "rules.py").write_text(RULES)
    (room / "kernel.py").write_text(KERNEL)
    (room.parent / "store.py").write_text(STORE)
    (room.parent / "main.py").write_text(MAIN)
    yield room.parent
    for folder in (tmp_path, *(path for path in tmp_path.rglob("*") if path.is_dir())):
        folder.chmod(stat.S_IRWXU)


def run(package, own="/nonexistent/own", main="main.py", **environment):
    environment = {
        **os.environ,
        "PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}",
        "PYTHONDONTWRITEBYTECODE": "1",
        "OWN": str(own),
        **environment,
    }
    words = [sys.executable, str(package / main)]
    done = subprocess.run(words, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout.strip()


COMPILED = "33.0 ['kernel', 'rule']"
LOADED = "33.0 []"


def test_kernels_serve_a_read_only_copy_elsewhere_with_other_times(package, tmp_path):
    assert run(package) == COMPILED  # the rule once, for a literal, a byte and an int64
    assert len(list((package / "kernels").iterdir())) == 1
    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(package, elsewhere, copy_function=shutil.copyfile)
    for path in (elsewhere, *elsewhere.rglob("*")):
        os.utime(path, (1, 1))
        path.chmod(path.stat().st_mode & ~0o222)
    assert run(elsewhere, HOME="/nonexistent", XDG_CACHE_HOME="") == LOADED


def test_bytecode_that_was_made_elsewhere_has_the_same_kernels(package):
    """Pytest keeps bytecode with the path by which a file was imported first."""
    moved = """
from importlib.machinery import SourceFileLoader
def get_code(loader, name):
    return compile(loader.get_data(loader.path), loader.path.replace("room", "former"), "exec")
SourceFileLoader.get_code = get_code
"""
    (package / "moved.py").write_text(moved + MAIN)
    assert run(package) == COMPILED
    assert run(package, main="moved.py") == LOADED
    assert len(list((package / "kernels").iterdir())) == 1


def test_a_whole_file_that_is_no_kernel_is_compiled_again(package):
    assert run(package) == COMPILED
    [file] = (package / "kernels").iterdir()
    KernelStore([file.parent]).write(file.name, pickle.dumps(("machine code",)))
    assert run(package) == COMPILED
    assert run(package) == LOADED


def test_a_changed_source_is_never_served_by_the_former_kernel(package):
    assert run(package) == COMPILED
    source = package / "room" / "rules.py"
    before = source.stat()
    source.write_text(source.read_text().replace("FACTOR = 3.0", "FACTOR = 4.0"))
    os.utime(source, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert run(package) == "39.0 ['kernel', 'rule']"
    assert len(list((package / "kernels").iterdir())) == 1  # the former one is gone


def test_kernels_that_cannot_be_kept_work_all_the_same(package):
    (package / "kernels").write_text("")
    assert [run(package, "/proc/nonexistent") for _ in range(2)] == [COMPILED, COMPILED]


def test_a_processor_without_the_baseline_compiles_its_own_and_leaves_the_others(package):
    assert run(package) == COMPILED
    foreign = {"NUMBA_CPU_NAME": "core2", "NUMBA_CPU_FEATURES": "+ssse3,+cx16"}
    assert run(package, **foreign) == COMPILED
    assert run(package, **foreign) == LOADED
    assert run(package) == LOADED
