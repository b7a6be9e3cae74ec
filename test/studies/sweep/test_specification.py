"""Sweeps as YAML files: what is taken, and one line for everything else."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from plain_values import contents, parse_specification
from support import refusal

from rpud_sim.model.contact_models import CONTACT_MODELS
from rpud_sim.model.parameters import QUANTITIES, REGIMES
from rpud_sim.studies.sweep.specification import DESIGNS, Range, Values
from rpud_sim.studies.sweep.specification_file import read_specification

CONFIG = Path(__file__).parents[3] / "config"

GRID = {
    "design": "grid",
    "duration": 0.5,
    "swept": {
        "weight_on_bit": {"minimum": 0, "maximum": 40, "points": 5},
        "contact_model": ["printed", "rayleigh"],
    },
}


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "spec.yaml"
        path.write_text(text)
        return path

    return write


def test_a_file_is_read_with_its_defaults(file):
    found = read_specification(file(yaml.safe_dump(GRID)))
    assert (found.design, found.points, found.seed, found.repeat) == ("grid", None, 0, 1)
    assert found.duration == 0.5
    assert found.fixed == {}
    assert found.swept == {
        "weight_on_bit": Range(0.0, 40.0, "linear", 5),
        "contact_model": Values(("printed", "rayleigh")),
    }
    assert (found.point_count, found.simulations) == (10, 10)


def changed(**entries):
    return {name: value for name, value in (GRID | entries).items() if value is not ...}


def swept(**entries):
    return changed(swept=entries)


LINE = {"minimum": 1.0, "maximum": 2.0, "points": 3}


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (changed(sweeps=1), "'sweeps' is not a key here; did you mean swept?"),
        (changed(points=4), "points: a grid has its points at each range of swept"),
        (changed(design="sobol"), "points is missing, the number of points of the sobol design"),
        (changed(design="sobol", points=12), "points = 12 is no power of two"),
        (changed(fixed={"weight_on_bit": 1}), "fixed: weight_on_bit is among swept as well"),
        (swept(), "swept names no parameter"),
        (swept(free_mass=[1, 1.0]), "swept.free_mass = [1, 1.0] has a value twice"),
        (swept(regime=LINE), "regime has no range; give a list of its values"),
        (
            swept(gravity=LINE | {"minimum": 0, "scale": "log"}),
            "swept.gravity.minimum = 0 has no logarithm",
        ),
        (
            changed(figures=["force"]),
            "figures[0] = 'force' is not a figure; known are events, drill_tool",
        ),
        (
            changed(design="saltelli", points=4, swept={"gravity": [1, 2]}, cases={"a": {}}),
            "design: a saltelli design takes neither cases nor faults",
        ),
        (changed(repeat=1_000_000, swept={"free_mass": LINE | {"points": 11}}), "are more than"),
    ],
)
def test_a_mistake_is_one_line_with_entry_and_reason(content, complaint):
    assert complaint in refusal(parse_specification, content)


KEYS, ANYTHING = contents(
    [
        *("design", "points", "seed", "repeat", "duration", "fixed", "swept", "minimum", "maximum"),
        *(*QUANTITIES, "regime", "contact_model"),
    ],
    [*DESIGNS, *REGIMES, *CONTACT_MODELS, "log"],
)


@given(entries=st.dictionaries(KEYS, ANYTHING, max_size=3), spread=ANYTHING)
@example(entries={"\n": None}, spread=None)
def test_hostile_content_is_taken_or_refused_in_one_line(entries, spread):
    for content in (entries, GRID | entries, swept(free_mass=spread), changed(fixed=spread)):
        if not refusal(parse_specification, content):
            assert 1 <= parse_specification(content).simulations <= 10_000_000


@given(
    low=st.floats(1e-6, 1.0),
    factor=st.floats(1.001, 1e6),
    scale=st.sampled_from(["linear", "log"]),
    shares=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20),
)
def test_a_range_keeps_to_itself_and_to_its_order(low, factor, scale, shares):
    spread = Range(low, low * factor, scale)
    values = spread.at(np.sort(shares))
    assert np.all(np.diff(values) >= 0.0)
    assert values[0] >= low
    assert values[-1] <= low * factor
    assert spread.at(np.array([0.0, 1.0])).tolist() == [low, low * factor]


def test_the_study_of_sensitivity_names_a_source_of_every_interval():
    example = read_specification(CONFIG / "sweep_sensitivity.yaml")
    assert all(interval.source for interval in example.swept.values())
