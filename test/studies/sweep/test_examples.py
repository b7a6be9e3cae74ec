"""Specifications of sweeps in the configuration: they are valid, and run at small size."""

from itertools import islice
from pathlib import Path

import pytest
from fault_signatures import ROWS

from rpud_sim.foundation.yaml_files import read_yaml
from rpud_sim.studies.sweep.specification_file import parse_specification, read_specification
from rpud_sim.studies.sweep.sweep import run_sweep

CONFIG = Path(__file__).parents[3] / "config"


@pytest.mark.extended
@pytest.mark.parametrize(
    ("name", "simulations"),
    [
        ("sweep", 256),
        ("sweep_faults", 4 * (1 + 18) * 2),
        ("sweep_faults_on_an_arm", 5 * (1 + 13)),
        ("sweep_sensitivity", 256 * (14 + 3)),
    ],
)
def test_an_example_has_its_size_and_runs_at_small_size(name, simulations, tmp_path):
    path = CONFIG / f"{name}.yaml"
    assert read_specification(path).simulations == simulations
    content = read_yaml(path, truth_values=False)
    small = {"points": 2, "duration": 0.4}
    if "faults" in content:
        small |= {
            "onset": {"minimum": 0.1, "maximum": 0.2},
            "lasting": {"minimum": 0.1, "maximum": 0.1},
            "faults": content["faults"][:3],
            "cases": dict(islice(content["cases"].items(), 2)),
        }
    result = run_sweep(parse_specification(content | small), tmp_path / "out", 1)
    assert (result.simulations > 0, result.failures) == (True, 0)


def test_the_example_on_an_arm_has_every_fault_of_a_drill_on_an_arm():
    example = read_specification(CONFIG / "sweep_faults_on_an_arm.yaml")
    assert {fault.kind for fault in example.faults.values()} == {*ROWS}


def test_the_study_of_sensitivity_names_a_source_of_every_interval():
    example = read_specification(CONFIG / "sweep_sensitivity.yaml")
    assert all(interval.source for interval in example.swept.values())
