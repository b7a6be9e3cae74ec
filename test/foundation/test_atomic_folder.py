"""A folder or a file has its name when it is complete, and never before."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rpud_sim.foundation.atomic_folder import (
    UNFINISHED,
    atomic_file,
    atomic_folder,
    make_folder,
    remove_folder,
)


def written(context, error):
    """Write in a context, and end it with an error."""

    def write():
        with context as path:
            (path / "file" if path.is_dir() else path).write_text("ne")
            raise error

    with pytest.raises(error):
        write()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_after_an_error_nothing_is_left_but_what_was_there(tmp_path, error):
    (tmp_path / "old").write_text("old")
    written(atomic_folder(tmp_path / "out"), error)
    written(atomic_file(tmp_path / "old"), error)
    assert os.listdir(tmp_path) == ["old"]
    assert (tmp_path / "old").read_text() == "old"


def test_folders_above_go_with_what_they_were_made_for(tmp_path):
    (tmp_path / "there").mkdir()
    for name in ("new/deep/out", "there/new/out"):
        written(atomic_folder(tmp_path / name), ValueError)
    assert sorted(tmp_path.rglob("*")) == [tmp_path / "there"]
    too_long = tmp_path / "new" / ("x" * 300)
    with pytest.raises(OSError, match="too long"):
        make_folder(too_long)
    made = make_folder(tmp_path / "new" / "deep")
    (tmp_path / "new" / "of others").touch()
    remove_folder(made)
    assert os.listdir(tmp_path / "new") == ["of others"]


def test_a_folder_that_another_process_makes_meanwhile_is_left_alone(tmp_path, monkeypatch):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "of another").touch()
    monkeypatch.setattr(os.path, "lexists", lambda path: Path(path) == tmp_path)
    with pytest.raises(FileExistsError):
        make_folder(tmp_path / "bag")
    assert os.listdir(tmp_path / "bag") == ["of another"]


def test_a_file_without_a_folder_is_named_before_the_work(tmp_path):
    path = tmp_path / "missing" / "table"
    missing = pytest.raises(FileNotFoundError, match=f"there is no folder {path.parent}")
    with missing as caught, atomic_file(path):
        pytest.fail("it was entered")
    assert caught.value.filename == str(path)


@pytest.mark.parametrize("name", ["out", "out.part"])
@pytest.mark.parametrize("make", ["mkdir", "touch", "symlink_to"])
def test_what_exists_is_named_and_left_alone(tmp_path, monkeypatch, name, make):
    monkeypatch.chdir(tmp_path)
    getattr(tmp_path / name, make)(*[tmp_path / "nowhere"] * (make == "symlink_to"))
    with pytest.raises(FileExistsError) as caught, atomic_folder("out"):
        pytest.fail("it was entered")
    assert caught.value.filename == name
    assert os.listdir(tmp_path) == [name]


def test_a_file_replaces_the_old_one_when_it_is_written(tmp_path):
    path = tmp_path / "table"
    path.write_text("old")
    with atomic_file(path) as unfinished:
        unfinished.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["table"]


_WRITER = """
import signal, sys
from pathlib import Path
from rpud_sim.cli.program import run_program
signal.signal(int(sys.argv[1]), signal.SIG_IGN)
from rpud_sim.foundation.atomic_folder import atomic_file, atomic_folder
def run():
    with atomic_folder("folder") as folder, atomic_file(folder / "a"), atomic_file(Path("b")) as b:
        b.write_text("half")
        print("half", flush=True)
        signal.pause()
run_program("writer", run)
"""


@pytest.mark.parametrize(
    ("number", "ignored"),
    [
        (signal.SIGINT, signal.SIGHUP),  # under nohup
        (signal.SIGTERM, signal.SIGINT),  # in the background of a script
        (signal.SIGHUP, signal.SIGINT),
    ],
)
def test_a_signal_leaves_nothing_that_is_not_whole(tmp_path, number, ignored):
    command = (sys.executable, "-c", _WRITER, str(int(ignored)))
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout.readline() == "half\n"
        writer.send_signal(number)
        assert writer.wait(60) == 128 + number
    assert os.listdir(tmp_path) == []


def test_the_rest_of_a_killed_process_is_overwritten_and_a_link_is_not_followed(tmp_path):
    path = tmp_path / "table"
    precious = tmp_path / "precious"
    precious.write_text("precious")
    (tmp_path / f"table{UNFINISHED}").symlink_to(precious)
    with atomic_file(path) as unfinished:
        unfinished.write_text("new")
    assert precious.read_text() == "precious"
    assert path.read_text() == "new"
    assert not path.is_symlink()
