"""What releases before 0.3 wrote: messages of a bag are listed, and a run names its release.

Their parameter files load.
"""

import json
from pathlib import Path

import pytest

from rpud_sim.simulation.versions import ENGINE

DATA = Path(__file__).parents[1] / "data"
BAG = DATA / "0.2.0" / "offline_free"
PARAMETER_FILES = sorted(DATA.glob("*.yaml"))


@pytest.mark.parametrize(
    "words",
    [
        ("verify", BAG),
        ("fork", BAG, "--at", 0.01, "--out", "fork"),
        ("compare", BAG, BAG),
        ("export", BAG, "--out", "rows", "--rate", 20000),
    ],
    ids=lambda words: words[0],
)
def test_a_run_of_an_older_release_names_the_release_that_reads_it(
    words, rpud, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    reason = f"made by rpud_sim 0.2.0, not by engine {ENGINE}: rpud_sim 0.2.0 reads it"
    assert rpud(*words) == (1, "", f"rpud {words[0]}: /rpud/journal: {reason}\n")
    assert not [*tmp_path.iterdir()]


def test_the_messages_of_an_older_bag_are_listed(rpud):
    code, out, err = rpud("info", BAG, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["message_count"] > 90


@pytest.mark.extended
def test_the_messages_of_an_older_bag_are_exported(tmp_path, rpud):
    assert rpud("export", BAG, "--out", tmp_path / "tables")[::2] == (0, "")


@pytest.mark.parametrize("file", PARAMETER_FILES, ids=lambda file: file.name)
def test_a_parameter_file_of_an_earlier_release_drills(file, rpud):
    code, printed, error = rpud("simulate", "--config", file, "--duration", "0.05")
    assert (code, error) == (0, "")
    assert "drill_tool_impact_rate" in printed
