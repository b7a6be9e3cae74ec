"""Files of kernels: whole or not used, and in the first folder that can be written to."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from rpud_sim.kernels.store import (
    BASELINE,
    BASELINE_FEATURES,
    KernelStore,
    Target,
    choose_target,
    kernel_name,
    notice,
    user_folders,
)

WHAT = ("room.f", "(float64,)", "x86-64-v2", "", "sources")
NAME = kernel_name(*WHAT)


@pytest.fixture
def store(tmp_path):
    """A store whose first folder is a file, and whose second can be written to."""
    (tmp_path / "taken").write_text("")
    return KernelStore((tmp_path / "taken", tmp_path / "kernels"))


def test_what_is_written_is_read_and_its_former_version_is_gone(store):
    former = kernel_name(*WHAT[:-1], "older sources")
    store.write(former, pickle.dumps("former"))
    assert store.place() == store.folders[1]
    file = store.write(NAME, pickle.dumps("present"))
    assert (store.read(NAME), store.read(former)) == ("present", None)
    assert list(store.folders[1].iterdir()) == [file]


def test_a_file_that_is_cut_short_or_changed_is_not_used(store):
    file = store.write(NAME, pickle.dumps("machine code"))
    data = file.read_bytes()
    changed = data[:-4] + bytes([data[-4] ^ 1]) + data[-3:]
    for damaged in (b"", data[:31], data[:32], data[:-1], changed):
        file.write_bytes(damaged)
        assert store.read(NAME) is None


def belongs(monkeypatch, strange, **changed):
    """Let a path have another owner or group, which only root could give it."""
    fstat, inode = os.fstat, strange.stat().st_ino

    def changed_fstat(descriptor):
        its = fstat(descriptor)
        fields = ("st_mode", "st_ino", "st_dev", "st_nlink", "st_uid", "st_gid", "st_size")
        values = [changed.get(name, getattr(its, name)) for name in fields]
        return os.stat_result((*values, 0, 0, 0)) if its.st_ino == inode else its

    monkeypatch.setattr(os, "fstat", changed_fstat)


@pytest.mark.parametrize("bits", [0o002, 0o020])
def test_what_others_may_write_is_not_read_and_the_reason_is_a_line(store, bits, monkeypatch):
    file = store.write(NAME, pickle.dumps("machine code"))
    file.chmod(file.stat().st_mode | bits)
    belongs(monkeypatch, file, st_gid=12345)  # a group that does not write this package
    assert store.read(NAME) is None
    assert store.rejection == f"{file} is not used, because other users may write it"
    assert store.rejection in notice(Target(BASELINE), store)


def test_what_another_user_owns_is_not_read(store, monkeypatch):
    file = store.write(NAME, pickle.dumps("machine code"))
    belongs(monkeypatch, file, st_uid=54321)
    assert store.read(NAME) is None
    assert store.rejection == f"{file} is not used, because other users may write it"


def test_a_fifo_a_link_and_what_cannot_be_unpickled_are_not_read(store, tmp_path):
    file = store.write(NAME, pickle.dumps("machine code"))
    whole = file.rename(tmp_path / "whole")
    file.symlink_to(whole)
    assert store.read(NAME) is None
    file.unlink()
    os.mkfifo(file)
    assert store.read(NAME) is None
    assert store.rejection == f"{file} is not used, because it is not a regular file"
    file.unlink()
    store.write(NAME, b"cbuiltins\nint\n(S'x'\ntR.")
    assert store.read(NAME) is None
    assert store.rejection.startswith(f"{file} is not used: ValueError")


def test_kernels_are_written_for_this_user_alone_whatever_the_mask(store):
    mask = os.umask(0)
    try:
        file = store.write(NAME, pickle.dumps(1))
    finally:
        os.umask(mask)
    assert [path.stat().st_mode & 0o777 for path in (file.parent, file)] == [0o755, 0o644]


def test_no_part_of_a_file_is_left_when_the_disk_is_full(store, monkeypatch):
    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    assert store.write(NAME, pickle.dumps(1)) is None
    assert not list(store.folders[1].iterdir())


@pytest.mark.parametrize(
    ("cache", "folder"),
    [("/c", "/c/rpud_sim/kernels"), ("", "/h/.cache/rpud_sim/kernels"), ("c", None)],
)
def test_the_users_folder_is_that_of_xdg(monkeypatch, cache, folder):
    monkeypatch.setenv("HOME", "/h")
    monkeypatch.setenv("XDG_CACHE_HOME", cache)
    assert [str(each) for each in user_folders()] == [folder or "/h/.cache/rpud_sim/kernels"]


ENOUGH = ",".join(f"+{name}" for name in sorted(BASELINE_FEATURES))


@pytest.mark.parametrize("more", ["", ",+avx512f,+fma4", ",-avx512f"])
def test_kernels_are_the_same_on_every_processor_with_the_baseline(more):
    assert choose_target("a processor", ENOUGH + more) == Target(BASELINE)


@pytest.mark.parametrize("missing", sorted(BASELINE_FEATURES))
def test_a_processor_without_one_instruction_has_kernels_of_its_own(missing):
    features = ENOUGH.replace(f"+{missing}", f"-{missing}", 1) + ",+fma4"
    target = choose_target("old", features)
    assert target.cpu == "old"
    assert target.features == features
    assert missing in target.lacking


SHIPPED = """
import sys
from pathlib import Path
from rpud_sim.model.compile import STORE
STORE.folders = Path(sys.argv[1]), Path(sys.argv[2])
from rpud_sim.cli.main import execute
short = ["simulate", "--duration", "0.05"]
for words in (["--seed", "3"], ["--repeat", "2"], ["--bag", "bag"], ["--regime", "free"]):
    assert execute([*short, *words]) == 0
assert execute(["verify", "bag"]) == 0
assert execute(["fork", "bag", "--at", "0.02", "--out", "other"]) == 0
print("compiled:", STORE.written)
"""


@pytest.mark.extended
def test_no_command_compiles_what_the_installed_kernels_should_have(tmp_path):
    """In two processes: this one may have compiled what is missing in the folder."""
    shipped, words = tmp_path / "shipped", {"cwd": tmp_path, "capture_output": True, "text": True}
    gathered = [sys.executable, "-m", "toolchain.precompile", "--into", str(shipped)]
    root = Path(__file__).parents[2]
    subprocess.run(gathered, check=True, cwd=root, capture_output=True)
    call = [sys.executable, "-c", SHIPPED, str(shipped), str(tmp_path / "own")]
    done = subprocess.run(call, check=False, **words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("compiled: []\n")
