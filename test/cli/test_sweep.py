"""`rpud sweep`: the same bytes whatever happens to its workers."""

import json
from pathlib import Path

import pytest
import yaml
from support import rpud, until

FILES = ("manifest.json", "points.parquet", "simulations.parquet")
SPECIFICATION = {
    "design": "latin_hypercube",
    "points": 16,
    "seed": 3,
    "repeat": 4,
    "duration": 10.0,
    "swept": {"weight_on_bit": {"minimum": 5.0, "maximum": 20.0}},
}
CHUNKS = 16


def descendants(pid):
    """Return the processes that a process has begun, and those that these have."""
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    except OSError:
        return []
    children = [int(word) for word in text.split()]
    return children + [inner for child in children for inner in descendants(child)]


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def chunks(folder):
    return set(folder.glob("chunks/*.arrow"))


def same(folder, other):
    return all((folder / name).read_bytes() == (other / name).read_bytes() for name in FILES)


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    path = tmp_path_factory.mktemp("specification") / "spec.yaml"
    path.write_text(yaml.safe_dump(SPECIFICATION))
    return path


@pytest.fixture(scope="module")
def made(spec, tmp_path_factory):
    """A sweep by one worker that nothing happened to."""
    folder = tmp_path_factory.mktemp("sweep") / "new" / "made"
    done = rpud("sweep", spec, "--out", folder, "--workers", 1, "--json")
    assert done.returncode == 0, done.stderr  # on a busy machine it shows its progress as well
    return folder, json.loads(done.stdout)


def test_one_object_says_what_was_made(made):
    folder, printed = made
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest == {name: printed[name] for name in manifest}
    assert (printed["points"], printed["simulations"], printed["chunks"]) == (16, 64, CHUNKS)
    assert (printed["run"], printed["kept"], printed["failures"]) == (64, 0, 0)
    assert printed["report"] == str(folder / "report.html")
    assert {path.name for path in folder.iterdir()} == {*FILES, "report.html"}


@pytest.mark.extended
def test_a_killed_sweep_goes_on_where_it_was(spec, made, tmp_path, process):
    out = tmp_path / "out"
    sweep = process("rpud", "sweep", spec, "--out", out, "--workers", "2")
    until(lambda: len(chunks(out)) > 1)
    begun = descendants(sweep.pid)
    assert len(begun) > 2
    sweep.kill()
    until(lambda: not any(map(alive, begun)))
    kept = {path: path.stat().st_mtime_ns for path in chunks(out)}
    assert 1 < len(kept) < CHUNKS
    again = rpud("sweep", spec, "--out", out, "--workers", 2, "--json")
    assert again.returncode == 0, again.stderr  # a slow machine shows progress there
    printed = json.loads(again.stdout)
    assert printed["kept"] == 4 * len(kept)
    assert printed["run"] == 64 - 4 * len(kept)
    assert same(out, made[0])


def test_a_finished_sweep_is_not_run_again(spec, made):
    folder, _ = made
    before = {name: (folder / name).stat().st_mtime_ns for name in FILES}
    again = rpud("sweep", spec, "--out", folder)
    assert again.returncode == 0
    assert "0 run, 64 kept" in again.stdout
    assert {name: (folder / name).stat().st_mtime_ns for name in FILES} == before


def test_a_folder_that_cannot_be_made_is_one_line(spec, tmp_path):
    (tmp_path / "file").write_text("")
    done = rpud("sweep", spec, "--out", tmp_path / "file" / "folder")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"rpud sweep: {tmp_path}/file/folder: Not a directory\n"
