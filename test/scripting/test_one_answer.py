"""The command line, Python and a bag give one answer to one question."""

import json

import pytest
import yaml
from support import called

import rpud_sim
from rpud_sim.simulation import run as run_module
from rpud_sim.simulation.plan import initial_phases

ROTATING = {"rotation_model": "friction_drive", "strata": "sandstone"}
OWN = {"real_time_factor", "regime", "repeat", "seed", "scenario", "parameters", "actuator"}
OWN |= {"rock", "rotation", "mount", "strata", "bit"}  # of the command line alone


@pytest.fixture
def simulate(capsys):
    """Call `rpud simulate --json` in this process; return what it prints, or the error's line."""

    def call(*words):
        code, output, errors = called(capsys, "simulate", "--json", "--duration", 0.2, *words)
        assert (code, errors) == (0, "") or (code, output) == (2, "")
        return json.loads(output) if output else errors.removeprefix("rpud simulate: ").strip()

    return call


@pytest.fixture(params=["figures", "bag"])
def words(request, tmp_path):
    """Options with and without a bag."""
    return () if request.param == "figures" else ("--bag", tmp_path / "bag")


@pytest.fixture
def config(tmp_path):
    """Write a parameter file for every node."""

    def write(**values):
        path = tmp_path / "drill.yaml"
        path.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}))
        return path

    return write


def flat(found):
    """Return numbers by name, those of an account with its name before them."""
    accounts = {name for name, value in found.items() if isinstance(value, dict)}
    inner = {f"{name}.{key}": each for name in accounts for key, each in found[name].items()}
    return {name: value for name, value in found.items() if name not in accounts} | inner


def metrics(found):
    return {name: value for name, value in found.items() if name not in OWN}


def test_a_planned_command_that_the_drill_cannot_take_is_an_error(simulate, words, tmp_path):
    file = tmp_path / "commands.yaml"
    file.write_text("commands: [{time: 0.1, feed: {rate: 0.001}}]")
    line = simulate("--commands", file, *words)
    with pytest.raises(rpud_sim.ParameterError) as caught:
        rpud_sim.simulate(0.2, commands=file).metrics  # noqa: B018
    assert line == str(caught.value) == "a feed cannot be commanded with feed_model = none"
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("seed", [None, 0, 5])
def test_a_seed_is_given_or_that_of_the_file_or_none(simulate, words, config, seed):
    [phase] = initial_phases(1, seed)
    assert (phase == 0.0) is (seed is None)
    given = () if seed is None else ("--seed", seed)
    expected = rpud_sim.simulate(0.2, seed=seed)
    assert expected.plan.beginning.initial_phase == phase
    found = simulate(*given, *words)
    assert metrics(found) == metrics(expected.metrics)
    assert found["seed"] == seed


def test_a_seed_of_a_file_counts_unless_another_is_given(simulate, words, config):
    file = config(seed=5)
    assert simulate("--config", file, *words)["seed"] == 5
    assert rpud_sim.simulate(0.2, config=file).seed == 5
    assert rpud_sim.simulate(0.2, config=file, seed=0).plan == rpud_sim.simulate(0.2, seed=0).plan


def test_a_seed_of_a_file_draws_what_the_same_seed_draws_that_is_given(simulate, config):
    assert simulate("--config", config(seed=0)) | {"real_time_factor": 0.0} == simulate(
        "--seed", 0
    ) | {"real_time_factor": 0.0}


def test_the_metrics_of_a_rotating_drill_are_the_same_by_every_way(simulate, words):
    found = simulate(*words, *(f"--set={name}={value}" for name, value in ROTATING.items()))
    expected = rpud_sim.simulate(0.2, **ROTATING).metrics
    assert metrics(found).keys() == expected.keys() >= {"rotation_account", "depth"}
    assert flat(metrics(found)) == pytest.approx(flat(expected), rel=1e-12)


def test_a_bag_and_its_metrics_are_computed_once(simulate, tmp_path, monkeypatch):
    ends = []
    advance = run_module.Run._advance

    def counted(run, until, defer):
        if until > 1_000_000:  # what compiles the kernels is shorter
            ends.append(until)
        return advance(run, until, defer)

    monkeypatch.setattr(run_module.Run, "_advance", counted)
    simulate("--bag", tmp_path / "bag")
    assert ends == [200_000_000]
