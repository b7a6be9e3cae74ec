"""Parameter files of earlier releases load, and a name that is not known any more says so."""

from pathlib import Path

import pytest

FILES = sorted((Path(__file__).parents[1] / "data").glob("*.yaml"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_a_parameter_file_of_an_earlier_release_drills(file, rpud):
    code, printed, error = rpud("simulate", "--config", file, "--duration", "0.05")
    assert (code, error) == (0, "")
    assert "drill_tool_impact_rate" in printed


def test_a_name_that_is_not_known_any_more_is_told_with_the_nearest(tmp_path, rpud):
    file = tmp_path / "old.yaml"
    file.write_text(FILES[0].read_text().replace("free_mass:", "free_masse:"))
    code, _, error = rpud("simulate", "--config", file, "--duration", "0.05")
    assert code == 2
    assert error.count("\n") == 1
    assert "free_masse" in error
    assert "did you mean free_mass?" in error
