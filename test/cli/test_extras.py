"""Commands where a package is missing that only some of them need."""

import pytest

pytestmark = pytest.mark.extended

BAGS = ("lz4", "mcap", "rosbags", "zstandard")
EXTRAS = ("matplotlib", "pandas", "pyarrow", "scipy", "tornado")


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
        (("compare", "bag", "--from", "0"), "needs scipy: pip install 'rpud_sim[web]'"),
    ],
)
def test_a_command_on_a_bag_names_its_extra(lacking, bag, words, line):
    done = lacking(EXTRAS, *(bag if word == "bag" else word for word in words), bag)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"rpud {words[0]}: {line}, or in a clone make setup\n"


def test_bags_need_no_extra(lacking, bag):
    page, whole = (("--out", bag.with_name(name)) for name in ("page.html", "whole"))
    for command, *words in (["info"], ["verify"], ["report", *page], ["recover", *whole]):
        done = lacking(EXTRAS, command, bag, *words)
        assert (done.returncode, done.stderr) == (0, ""), command


def test_a_sweep_names_its_extra(lacking):
    done = lacking(EXTRAS, "sweep", "--set", "weight_on_bit=5,10")
    assert (done.returncode, done.stdout) == (1, "")
    text = "needs pandas: pip install 'rpud_sim[studies]', or in a clone make setup"
    assert done.stderr == f"rpud sweep: {text}\n"


def test_without_the_libraries_of_bags_a_command_says_what_to_install(lacking):
    done = lacking(BAGS, "info", "bag")
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.endswith(": pip install lz4 mcap rosbags zstandard")


def test_without_the_libraries_of_bags_the_drill_runs(lacking):
    done = lacking(BAGS, "run", "--duration", "0.2", "--quiet")
    assert done.returncode == 0, done.stderr
    assert "drilled 0.20 s" in done.stdout
