"""Commands where a package is missing that only some of them need."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.extended

CONFIG = Path(__file__).parents[2] / "config"
BAGS = ("apsw", "lz4", "mcap", "rosbags", "zstandard")
EXTRAS = ("distributed", "pandas", "pyarrow", "scipy", "tornado")

# Imports the command line where some packages are missing; a name that is None cannot be imported.
SCRIPT = """
import sys
sys.modules.update(dict.fromkeys(sys.argv.pop(1).split(",")))
from rpud_sim.cli.main import main
main()
"""


@pytest.fixture
def lacking(tmp_path):
    """Run `rpud` where packages are missing, in a folder of its own."""

    def run(packages, *words):
        return subprocess.run(
            [sys.executable, "-c", SCRIPT, ",".join(packages), *words],
            cwd=tmp_path,
            env={**os.environ, "RPUD_TRACEBACK": ""},
            capture_output=True,
            text=True,
            timeout=100.0,
            check=False,
        )

    return run


@pytest.fixture
def bag(lacking):
    """Record without ROS, by the plain installation."""
    done = lacking(EXTRAS, "simulate", "--duration", "0.1", "--bag", "bag")
    assert (done.returncode, done.stderr) == (0, "")
    return "bag"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("export", "bag", "--out", "out"), r"needs pyarrow: pip install 'rpud_sim\[export\]'"),
        (("watch", "bag"), r"needs tornado: pip install 'rpud_sim\[web\]'"),
        (("compare", "bag", "bag"), r"needs scipy: pip install 'rpud_sim\[web\]'"),
    ],
)
def test_a_command_on_a_bag_names_its_extra(lacking, bag, words, line):
    done = lacking(EXTRAS, *words)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"rpud {words[0]}: {line}\n".replace("\\", "")


def test_bags_need_no_extra(lacking, bag):
    calls = (["info", bag], ["verify", bag], ["report", bag], ["recover", bag, "--out", "whole"])
    for words in calls:
        done = lacking(EXTRAS, *words)
        assert (done.returncode, done.stderr) == (0, ""), words


@pytest.mark.parametrize("command", ["sweep", "fit"])
def test_a_study_names_the_extra_of_all_studies(lacking, command):
    file = {"sweep": "sweep.yaml", "fit": "fit_example.yaml"}[command]
    done = lacking(EXTRAS, command, str(CONFIG / file), "--out", "out")
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    missing = line.removeprefix(f"rpud {command}: needs ").partition(":")[0]
    assert missing in EXTRAS
    assert line == f"rpud {command}: needs {missing}: pip install 'rpud_sim[studies]'"


def test_without_the_libraries_of_bags_a_command_says_what_to_install(lacking):
    done = lacking(BAGS, "info", "bag")
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.endswith(": pip install apsw lz4 mcap rosbags zstandard")


def test_without_the_libraries_of_bags_the_drill_runs(lacking):
    done = lacking(BAGS, "run", "--duration", "0.2", "--quiet")
    assert done.returncode == 0, done.stderr
    assert "drilled 0.20 s" in done.stdout
