"""`rpud sweep`: a table, a file and pictures of the runs that rpud_sim.sweep gives."""

import json
import sys

import pandas
import pytest
from support import extended

import rpud_sim

WORDS = ("sweep", "--duration", 0.2, "--seeds", 2)
GRID = ("--set", "weight_on_bit=5,20", "--set", "contact_model=given,rayleigh")


@pytest.mark.parametrize("ending", ["csv", extended("parquet")])
def test_a_grid_is_a_file_with_a_row_for_each_run(rpud, tmp_path, ending):
    file = tmp_path / f"runs.{ending}"
    code, output, errors = rpud(*WORDS, *GRID, "--out", file)
    assert (code, errors) == (0, "")
    head, *rows, count, path = output.splitlines()
    assert head.startswith("weight_on_bit [N]  contact_model  drill_tool_impact_rate [1/s]  ")
    assert (len(rows), count, path) == (4, "8 runs, 0 failed", str(file))
    frame = pandas.read_csv(file) if ending == "csv" else pandas.read_parquet(file)
    figures = rpud_sim.simulate(0.2, seed=1, weight_on_bit=20, contact_model="given").metrics
    (row,) = frame.query("weight_on_bit == 20 and contact_model == 'given' and seed == 1").iloc
    assert row["contact_force_mean"] == figures["contact_force_mean"]


def test_what_a_file_or_a_picture_needs_is_looked_for_before_the_work(rpud, tmp_path, monkeypatch):
    monkeypatch.setattr("rpud_sim.scripting.sweep.sweep", lambda *_: pytest.fail("it worked"))
    file = tmp_path / "missing" / "runs.csv"
    expected = f"rpud sweep: {file}: there is no folder {file.parent}\n"
    assert rpud(*WORDS, *GRID, "--out", file) == (1, "", expected)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    code, output, errors = rpud(*WORDS, *GRID, "--plots", tmp_path / "plots")
    assert (code, output) == (1, "")
    assert errors.startswith("rpud sweep: needs matplotlib: pip install")
    assert not (tmp_path / "plots").exists()


def test_points_of_a_csv_file_go_with_values(rpud, tmp_path):
    (tmp_path / "points.csv").write_text("weight_on_bit,faults\n5,\n20,free_mass_jammed\n")
    given = ("--points", tmp_path / "points.csv", "--set", "regime=drilling", "--json")
    code, output, _ = rpud(*WORDS, *given)
    content = json.loads(output)
    assert code == 0
    assert content["units"]["weight_on_bit"] == "N"
    assert [(row["weight_on_bit"], row["faults"], row["seed"]) for row in content["rows"]] == [
        (5, None, 0),
        (5, None, 1),
        (20, "free_mass_jammed", 0),
        (20, "free_mass_jammed", 1),
    ]
    healthy, _, jammed, _ = (row["energy_absorbed_rate"] for row in content["rows"])
    assert healthy != jammed


@pytest.mark.extended
def test_there_is_a_picture_of_each_figure(rpud, tmp_path):
    code, *_ = rpud(*WORDS, *GRID, "--plots", tmp_path / "plots")
    assert code == 0
    names = {path.name for path in (tmp_path / "plots").iterdir()}
    assert names >= {"contact_force_mean.png", "drill_tool_impact_rate.png"}


def test_a_file_that_cannot_be_written_ends_it_before_the_work(rpud, tmp_path):
    file = tmp_path / "none" / "runs.csv"
    code, output, errors = rpud(*WORDS, *GRID, "--out", file)
    assert (code, output) == (1, "")
    assert errors.startswith(f"rpud sweep: {file}")
