"""Data of a drill: its summary figures become targets, with sampling errors."""

import numpy as np
import pytest
from plain_values import parse_targets
from support import refusal

from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation.configuration import to_configuration, to_settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.studies.fit.measures import measure

FIT = {"parameters": {"regime": "drilling"}, "unknowns": {"weight_on_bit": [2.0, 20.0]}}


def from_data(folder, **entry):
    return parse_targets(FIT | {"data": [entry]}, folder)


def write_csv(path, count=2000, field="peak_force"):
    random = np.random.default_rng(1)
    times = np.sort(random.uniform(0.0, 10.0, count))
    forces = random.lognormal(np.log(1000.0), 0.5, count)
    rows = "".join(f"{t!r},{f!r}\n" for t, f in zip(times.tolist(), forces.tolist(), strict=True))
    path.write_text(f"time,{field}\n{rows}")
    return times, forces


def test_impacts_of_a_csv_file_become_targets_with_their_sampling_errors(tmp_path):
    times, forces = write_csv(tmp_path / "drill.csv")
    found = from_data(tmp_path, csv="drill.csv", skip=1.0)
    targets = {str(target.measure): target for target in found.targets}
    kept = forces[times >= times[0] + 1.0]
    mean = targets["peak_force, mean, 1 to 6 s"]
    assert mean.value == pytest.approx(kept.mean(), rel=1e-3)
    assert mean.sampling == pytest.approx(kept.std() / np.sqrt(len(kept)), rel=0.7)
    assert targets["drill_tool_impact_rate, 1 to 6 s"].value == pytest.approx(200.0, rel=0.05)
    assert targets["peak_force, 95 % quantile, 1 to 6 s"].value > mean.value


def test_a_bag_gives_penetration_torque_and_power_to_a_drill_that_has_them(tmp_path):
    models = {
        "regime": "drilling",
        "actuator_model": "resonance",
        "rock_model": "specific_energy",
        "rotation_model": "friction_drive",
    }
    write_offline_bag(tmp_path / "bag", Plan(Beginning(to_settings(models), 0.0)), 3.0)
    found = parse_targets(
        FIT | {"parameters": models, "data": [{"bag": "bag", "skip": 0.5}]}, tmp_path
    )
    targets = {target.measure.figure: target for target in found.targets}
    names = ("penetration_rate", "torque", "electrical_power")
    window = [targets[name].measure for name in names]
    assert {(item.start, round(item.end, 1)) for item in window} == {(0.5, 3.0)}
    run = measure(to_configuration(models), 0.0, window)
    assert [targets[name].value for name in names] == pytest.approx(run, rel=0.03)
    without = from_data(tmp_path, bag="bag")
    assert not {target.measure.figure for target in without.targets} & set(names)


def test_a_column_of_depths_becomes_a_rate_of_penetration(tmp_path):
    rows = "".join(f"{0.1 * n},{2e-5 * n + 1e-6 * (n % 3)}\n" for n in range(100))
    (tmp_path / "drill.csv").write_text(f"time,depth\n{rows}")
    (found,) = from_data(
        tmp_path, csv="drill.csv", parameters={"rock_model": "specific_energy"}
    ).targets
    assert str(found.measure).startswith("penetration_rate")
    assert found.value == pytest.approx(2e-4, rel=0.01)
    assert found.error(0.0) < 0.02 * found.value


NEGATIVE = "time,peak_force\n" + "".join(f"{0.01 * n},{-1000 - n}\n" for n in range(200))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "has no column named time or header.stamp"),
        ("time,peak_force\n1,2\n", "has neither 100 impacts nor 20 samples"),
        ("time,peak_force\n1,two\n", "line 2 has no number in peak_force"),
        pytest.param(NEGATIVE, "mean, 0 to 1.99 s is -1099 N, and the model's", id="negative"),
    ],
)
def test_a_file_without_data_is_refused_in_one_line(tmp_path, text, complaint):
    (tmp_path / "drill.csv").write_text(text)
    assert complaint in refusal(lambda: from_data(tmp_path, csv="drill.csv", skip=0.0))
