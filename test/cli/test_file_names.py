"""Names of files are bytes: any locale and any folder will do."""

import os
import subprocess
import sys

from sample_bags import write_bag

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


def test_any_locale_and_any_folder_will_do(tmp_path):
    folder = os.fsencode(tmp_path) + b"/\xff"
    os.mkdir(folder)
    write_bag(tmp_path / "größe")
    os.rename(tmp_path / "größe", folder + "/größe".encode())
    bag = b"\xff/" + "größe".encode()
    recovered, simulated, page, table = (b"\xff/" + f"ä{n}".encode() for n in range(4))
    codes, errors = rpud(
        tmp_path,
        ("report", bag, "--out", page + b".html"),
        ("export", bag, "--out", table, "--format", "csv"),
        ("recover", bag, "--out", recovered),
        ("simulate", "--duration", "0.1", "--bag", simulated),
        ("info", recovered),
        ("info", simulated),
    )
    # A command that takes longer than 10 s prints how far it is.
    assert (codes, "rpud " in errors) == (str([0] * 6), False), errors


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
