"""Files of kernels: whole or not used, and in the first folder that can be written to."""

import os
import pickle
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
    stat = Path.stat

    def changed_stat(path, **how):
        its = stat(path, **how)
        fields = ("st_mode", "st_ino", "st_dev", "st_nlink", "st_uid", "st_gid", "st_size")
        values = [changed.get(name, getattr(its, name)) for name in fields]
        return os.stat_result((*values, 0, 0, 0)) if path == strange else its

    monkeypatch.setattr(Path, "stat", changed_stat)


@pytest.mark.parametrize("strange", ["folder", "file"])
@pytest.mark.parametrize("bits", [0o002, 0o020])
def test_what_others_may_write_is_not_read_and_the_reason_is_a_line(
    store, strange, bits, monkeypatch
):
    file = store.write(NAME, pickle.dumps("machine code"))
    path = file.parent if strange == "folder" else file
    path.chmod(path.stat().st_mode | bits)
    belongs(monkeypatch, path, st_gid=12345)  # a group that does not write this package
    assert store.read(NAME) is None
    assert store.refused == f"{path} is not used, because other users may write it"
    assert store.refused in notice(Target(BASELINE), store)
    if strange == "folder":
        assert store.place() is None
        assert store.write(NAME, pickle.dumps("mine")) is None


def test_what_another_user_owns_is_not_read(store, monkeypatch):
    belongs(monkeypatch, store.write(NAME, pickle.dumps("machine code")), st_uid=54321)
    assert store.read(NAME) is None


def test_kernels_are_written_for_this_user_alone_whatever_the_mask(store):
    mask = os.umask(0)
    try:
        file = store.write(NAME, pickle.dumps(1))
    finally:
        os.umask(mask)
    assert [path.stat().st_mode & 0o777 for path in (file.parent, file)] == [0o755, 0o644]


def test_no_part_of_a_file_is_left_when_the_disk_is_full(store, monkeypatch):
    def full(path, data):
        path.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
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
