"""`rpud simulate` prints figures that other programs rely on."""

import json
import math
import re

import pytest
from support import called, exhaust

from rpud_sim.model.parameters import NAMES
from rpud_sim.simulation import preset
from rpud_sim.simulation.metrics import METRICS, Metrics
from rpud_sim.simulation.simulation import Simulation

CONTRACT = {
    "duration",
    "events",
    "drill_tool_impact_rate",
    "actuator_impact_rate",
    "impact_velocity_mean",
    "contact_force_mean",
    "contact_force_max",
    "kinetic_energy_rate",
    "reacting_force_mean",
    "real_time_factor",
}


@pytest.fixture
def simulate(capsys):
    """Call `rpud simulate` in this process; give exit code, standard output and standard error."""
    return lambda *words: called(capsys, "simulate", *words)


@pytest.fixture
def figures(simulate):
    """Call `rpud simulate --json` and give what it says."""

    def call(*words):
        code, output, errors = simulate("--json", *words)
        assert (code, errors) == (0, "")
        # One object that every reader of JSON takes: without NaN and Infinity.
        return json.loads(output, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))

    return call


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_json_has_the_contract_s_figures(figures, regime):
    found = figures("--regime", regime, "--duration", 2)
    assert found.keys() >= CONTRACT
    for name in CONTRACT:
        assert isinstance(found[name], (int, float)), name
        assert found[name] > 0, name
        assert math.isfinite(found[name]), name
    assert type(found["events"]) is int
    assert found["duration"] == 2.0
    assert found["regime"] == regime
    assert "standard_error" not in found  # of a single run
    assert found["contact_force_max"] >= found["contact_force_mean"]
    statistics = Metrics()
    statistics.add(Simulation(preset(regime)).advance_to(2_000_000_000))
    assert found.items() >= statistics.values().items()


def test_an_ensemble_has_a_standard_error_for_each_figure(figures):
    found = figures("--duration", 0.5, "--repeat", 8, "--seed", 1)
    assert found["repeat"] == 8
    assert found["seed"] == 1
    errors = found["standard_error"]
    assert set(METRICS) <= errors.keys()
    for name in METRICS:
        assert 0.0 < errors[name] <= found[name], name


def test_regime_and_assignments_overrule_the_file(figures, tmp_path):
    file = tmp_path / "mine.yaml"
    parameters = "{regime: drilling, weight_on_bit: 1.0e1, gravity: 1.62}"
    file.write_text(f"/**:\n  ros__parameters: {parameters}\n")
    words = ("--regime", "free", "--set", "weight_on_bit=15", "--duration", 0.1)
    found = figures("--config", file, *words)
    assert found["regime"] == "free"
    assert found["parameters"]["weight_on_bit"] == 15.0
    assert found["parameters"]["gravity"] == 1.62
    assert found["parameters"].keys() == set(NAMES)


def test_the_table_has_every_figure_with_its_unit(simulate):
    code, output, errors = simulate("--duration", 1, "--repeat", 2)
    assert (code, errors) == (0, "")
    lines = {line.split()[0]: line.split() for line in output.splitlines()}
    assert lines.keys() >= CONTRACT
    assert lines["reacting_force_mean"][-1] == "N"
    assert lines["impact_velocity_mean"][-1] == "m/s"
    assert lines["drill_tool_impact_rate"][-1] == "1/s"
    assert lines["reacting_force_mean"][2] == "+-"


def test_a_scenario_draws_with_the_seed_that_is_given(figures, tmp_path):
    file = tmp_path / "faults.yaml"
    file.write_text("faults: [{kind: free_mass_jammed, onset: {uniform: [0.2, 1.8]}}]")
    words = ["--duration", 2.0, "--set", f"scenario={file}"]
    found = [figures(*words, "--seed", seed) for seed in (1, 2, 1)]
    rates = [each["drill_tool_impact_rate"] for each in found]
    assert rates[0] == rates[2] != rates[1]
    assert found[0]["scenario"] == str(file)


@pytest.mark.parametrize(
    ("scenario", "complaint"),
    [
        ("faults: [{kind: hard_rock, onset: 1.0}]", ":1: hard_rock is not possible: it needs"),
        ("faults: 3", ":1: faults = 3 is not a list"),
        (None, ": No such file or directory"),
    ],
)
@pytest.mark.parametrize("bag", [True, False])
def test_a_scenario_that_cannot_be_used_is_refused_before_anything(
    simulate, tmp_path, scenario, complaint, bag
):
    file = tmp_path / "faults.yaml"
    if scenario is not None:
        file.write_text(scenario)
    words = ["--bag", tmp_path / "bag"] if bag else []
    code, output, errors = simulate("--set", f"scenario={file}", *words)
    assert (code, output) == (2, "")
    assert errors.startswith(f"rpud simulate: {file}{complaint}")
    assert errors.count("\n") == 1
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("several", [(), ("--repeat", "2")])
def test_a_drill_beyond_its_event_budget_ends_with_one_line(simulate, monkeypatch, several):
    exhaust(monkeypatch)
    micro = ("--regime", "free", "--set", "free_mass=1e-7", "--set", "weight_on_bit=60")
    code, _, errors = simulate(*micro, "--duration", "0.1", *several)
    assert code == 1
    assert re.fullmatch(
        r"rpud simulate: events exceed their budget of 500000 in a simulated second at [\d.e-]+ s, "
        r"with free_mass = 1e-07 kg \(default: 0\.005\)\n",
        errors.splitlines(keepends=True)[-1],
    )


@pytest.mark.parametrize("words", [(), ("--json",)])
def test_a_figure_that_is_not_finite_is_an_error_with_its_name(simulate, monkeypatch, words):
    values = Metrics.values

    def broken(metrics):
        return {**values(metrics), "contact_force_max": math.nan}

    monkeypatch.setattr(Metrics, "values", broken)
    code, output, errors = simulate("--duration", 0.1, *words)
    assert (code, output) == (1, "")
    assert errors == "rpud simulate: contact_force_max = nan is not a finite number\n"
