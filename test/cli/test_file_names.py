"""Names of files are bytes: any locale and any folder will do."""

import os
import subprocess
import sys

import pytest
from sample_bags import write_bag
from support import extended

# Several commands in one process, whose words are given with a line for each.
PROGRAM = r"""
import sys
from rpud_sim.cli.main import main
codes = []
for line in sys.argv[1].split("\n"):
    try:
        main(line.split("\t"))
    except SystemExit as end:
        codes.append(end.code or 0)
print(codes)
"""


def rpud(folder, *commands):
    """Call commands in a process with another locale; give their exit codes and the errors."""
    lines = b"\n".join(b"\t".join(map(os.fsencode, words)) for words in commands)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, lines],
        cwd=folder,
        env={**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0"},
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1].decode(), done.stderr.decode()


BAG, TABLE, RECOVERED, SIMULATED = (b"\xff/" + f"{name}ä".encode() for name in "btrs")
EXPORT = ("export", BAG, "--out", TABLE, "--format", "csv")


@pytest.mark.parametrize("further", [(), extended((EXPORT,))])
def test_any_locale_and_any_folder_will_do(tmp_path, further):
    folder = os.fsencode(tmp_path) + b"/\xff"
    os.mkdir(folder)
    os.rename(write_bag(tmp_path / "bag"), os.fsencode(tmp_path) + b"/" + BAG)
    commands = (
        ("report", BAG, "--out", BAG + b".html"),
        ("recover", BAG, "--out", RECOVERED),
        ("simulate", "--duration", "0.1", "--bag", SIMULATED),
        ("info", RECOVERED),
        ("info", SIMULATED),
        *further,
    )
    codes, errors = rpud(tmp_path, *commands)
    # A command that takes longer than 10 s prints how far it is.
    assert (codes, "rpud " in errors) == (str([0] * len(commands)), False), errors


def test_a_bag_s_own_name_must_be_utf_8(tmp_path):
    write_bag(tmp_path / "bag")
    commands = (("recover", "bag"), ("simulate", "--duration", "0.1", "--bag"))
    recover, simulate = (*commands[0], "--out", b"\xff"), (*commands[1], b"\xff")
    codes, errors = rpud(tmp_path, recover, simulate)
    assert codes == "[1, 1]"
    assert errors.splitlines() == [
        rf"rpud {name}: the name '\udcff' is not UTF-8, as a bag's must be"
        for name in ("recover", "simulate")
    ]
    assert os.listdir(os.fsencode(tmp_path)) == [b"bag"]
