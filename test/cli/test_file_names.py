"""Names of files are bytes: any locale and any folder will do."""

import os
import subprocess
import sys

import pytest
from sample_bags import write_bag


def rpud(folder, *words):
    return subprocess.run(
        [sys.executable, "-m", "rpud_sim.cli.main", *words],
        cwd=folder,
        env={**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0"},
        capture_output=True,
        check=False,
    )


@pytest.mark.parametrize(
    "words",
    [
        ["report", "{bag}", "--out", "{new}.html"],
        ["export", "{bag}", "--out", "{new}", "--format", "csv"],
        ["recover", "{bag}", "--out", "{new}"],
        ["simulate", "--duration", "0.1", "--bag", "{new}"],
    ],
    ids=lambda words: words[0],
)
def test_any_locale_and_any_folder_will_do(tmp_path, words):
    folder = os.fsencode(tmp_path) + b"/\xff"
    os.mkdir(folder)
    write_bag(tmp_path / "größe")
    os.rename(tmp_path / "größe", folder + "/größe".encode())
    names = {
        "bag": os.fsdecode(b"\xff/" + "größe".encode()),
        "new": os.fsdecode(b"\xff/" + "ä".encode()),
    }
    done = rpud(tmp_path, *(os.fsencode(word.format(**names)) for word in words))
    # A command that takes longer than 10 s prints how far it is.
    assert (done.returncode, b"rpud " in done.stderr) == (0, False)
    if words[0] in ("recover", "simulate"):
        assert rpud(tmp_path, "info", os.fsencode(names["new"])).returncode == 0


@pytest.mark.parametrize(
    "words", [["recover", "bag", "--out"], ["simulate", "--duration", "0.1", "--bag"]]
)
def test_a_bag_s_own_name_must_be_utf_8(tmp_path, words):
    write_bag(tmp_path / "bag")
    done = rpud(tmp_path, *words, b"\xff")
    reason = rf"rpud {words[0]}: the name '\udcff' is not UTF-8, as a bag's must be"
    assert (done.returncode, done.stderr.decode().strip()) == (1, reason)
    assert os.listdir(os.fsencode(tmp_path)) == [b"bag"]
