"""Commands where a package is missing that only some of them need."""

from pathlib import Path

import pytest

pytestmark = pytest.mark.extended

CONFIG = Path(__file__).parents[2] / "config"
BAG = Path(__file__).parents[1] / "data" / "0.2.0" / "offline_free"
BAGS = ("lz4", "mcap", "rosbags", "zstandard")
EXTRAS = ("distributed", "emcee", "matplotlib", "pandas", "pyarrow", "scipy", "tornado")


@pytest.fixture
def bag(lacking, tmp_path):
    """Record without ROS, by the plain installation."""
    done = lacking(EXTRAS, "simulate", "--duration", "0.1", "--bag", tmp_path / "bag")
    assert (done.returncode, done.stderr) == (0, "")
    return tmp_path / "bag"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("export", "--out", "out"), "needs pyarrow: pip install 'rpud_sim[export]'"),
        (("watch",), "needs tornado: pip install 'rpud_sim[web]'"),
        (("compare", BAG), "needs scipy: pip install 'rpud_sim[web]'"),
    ],
)
def test_a_command_on_a_bag_names_its_extra(lacking, words, line):
    done = lacking(EXTRAS, *words, BAG)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"rpud {words[0]}: {line}, or in a clone make setup\n"


def test_bags_need_no_extra(lacking, bag):
    page, whole = (("--out", bag.with_name(name)) for name in ("page.html", "whole"))
    for command, *words in (["info"], ["verify"], ["report", *page], ["recover", *whole]):
        done = lacking(EXTRAS, command, bag, *words)
        assert (done.returncode, done.stderr) == (0, ""), command


@pytest.mark.parametrize(("command", "file"), [("sweep", "sweep"), ("fit", "fit_example")])
def test_a_study_names_the_extra_of_all_studies(lacking, command, file):
    done = lacking(EXTRAS, command, CONFIG / f"{file}.yaml", "--out", "out")
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    missing = line.removeprefix(f"rpud {command}: needs ").partition(":")[0]
    assert missing in EXTRAS
    command_line = "pip install 'rpud_sim[studies]', or in a clone make setup"
    assert line == f"rpud {command}: needs {missing}: {command_line}"


def test_without_the_libraries_of_bags_a_command_says_what_to_install(lacking):
    done = lacking(BAGS, "info", "bag")
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.endswith(": pip install lz4 mcap rosbags zstandard")


def test_without_the_libraries_of_bags_the_drill_runs(lacking):
    done = lacking(BAGS, "run", "--duration", "0.2", "--quiet")
    assert done.returncode == 0, done.stderr
    assert "drilled 0.20 s" in done.stdout
