"""The studies among the examples: a fit, Sobol indices, labelled bags of faults."""

import csv
import importlib.util
import json
import re
from importlib import import_module
from pathlib import Path

import pytest

import rpud_sim

FOLDER = Path(__file__).parents[2] / "examples"
PARAMETERS = (
    "vibration_amplitude",
    "actuator_restitution",
    "weight_on_bit",
    "free_mass",
    "effective_tool_mass",
    "effective_tool_spring_rate",
)


def executed(notebook):
    """Run a notebook. Its module needs matplotlib, which `make test` does not install."""
    return import_module("toolchain.notebook").executed(notebook)


def example(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def tables(notebook):
    """Return the rows of numbers that a notebook prints, by name, one mapping for each output."""
    texts = [
        "".join(output.get("text", ()))
        for cell in notebook["cells"]
        for output in cell.get("outputs", ())
    ]
    row = re.compile(r"^(\w+) +([-+\d.e ]+)$", re.MULTILINE)
    found = [{n: [*map(float, v.split())] for n, v in row.findall(text)} for text in texts]
    return [table for table in found if table]


NOTEBOOK = (FOLDER / "fit.ipynb").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def fitted():
    return tables(executed(json.loads(NOTEBOOK)))


@pytest.mark.extended
def test_a_short_fit_runs_every_cell():
    short = NOTEBOOK.replace("rounds=3, points=64, duration=10", "rounds=1, points=64, duration=1")
    assert short != NOTEBOOK
    bag, ridge = tables(executed(json.loads(short.replace("rounds=2", "rounds=1"))))
    assert set(ridge) < set(bag) == set(PARAMETERS)


@pytest.mark.extended
def test_the_fit_of_a_bag_finds_six_of_six_parameters(fitted):
    bag, _ = fitted
    assert set(bag) == set(PARAMETERS)
    for name, (low, middle, high, truth) in bag.items():
        assert low < truth < high, name
        assert high - low < 0.15 * middle, name


@pytest.mark.extended
def test_the_fit_of_figures_finds_the_weight_and_shows_the_ridge(fitted):
    _, ridge = fitted
    low, _, high = ridge["weight_on_bit"]
    assert 6.0 < low < high < 12.0
    for name in ("vibration_amplitude", "actuator_restitution"):
        low, middle, high = ridge[name]
        assert high - low > 0.5 * middle, "the figures do not determine it"


@pytest.mark.extended
def test_the_notebook_shows_the_same_findings(fitted):
    """Digits that a linear algebra library may change are not compared."""
    kept = tables(json.loads(NOTEBOOK))
    for found, shown in zip(fitted, kept, strict=True):
        assert found.keys() == shown.keys()
        for name, values in found.items():
            assert values == pytest.approx(shown[name], rel=0.1), name


@pytest.mark.extended
def test_the_truth_of_labelled_bags_is_that_of_their_runs(tmp_path, monkeypatch):
    labelled = example("labelled_faults")
    monkeypatch.setattr(labelled, "ROCKS", {"chalk": labelled.ROCKS["chalk"]})
    labelled.main(tmp_path / "bags", 1.0)
    with open(tmp_path / "bags" / "labels.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["kind"] for row in rows] == ["", *(each["kind"] for each in labelled.FAULTS)]
    for row in rows:
        assert rpud_sim.verify(tmp_path / "bags" / row["bag"]).proved
        with rpud_sim.open(tmp_path / "bags" / row["bag"]) as bag:
            last = bag.runs[0]["faults"]["faults"][-1:]
        assert bool(row["kind"]) == (len(last) == 1 and len(last[0]) == 1)
        if row["kind"]:
            assert 0.4 <= float(row["onset"]) <= 0.6
            assert float(row["onset"]) + 0.2 <= float(row["clear"]) <= float(row["onset"]) + 0.3


@pytest.mark.extended
def test_the_free_mass_decides_most_figures(optional_packages, capsys):
    sobol = example("sobol")
    assert all(source for *_, source in sobol.INTERVALS.values())
    sobol.main(16, 1.0)
    lines = capsys.readouterr().out.splitlines()
    heads = [number for number, line in enumerate(lines) if not line.startswith(" ")]
    assert len(heads) == len(sobol.METRICS)
    assert sum("free_mass" in lines[number + 1] for number in heads) >= 2
