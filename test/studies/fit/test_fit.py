"""Fits as a whole: intervals that hold the truth, choices that differ, files that serve."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.pages.plot import axis_ends
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.parameter_files import read_parameter_file
from rpud_sim.studies.fit import branches
from rpud_sim.studies.fit import fit as rounds
from rpud_sim.studies.fit.branches import FitError, named_points
from rpud_sim.studies.fit.design import values_at
from rpud_sim.studies.fit.fit import fit_in, run_fit
from rpud_sim.studies.fit.fit_plots import corner_rows, target_plot, unknown_quantity
from rpud_sim.studies.fit.fit_report import write_fit
from rpud_sim.studies.fit.folder import FitFolder
from rpud_sim.studies.fit.proof import prove
from rpud_sim.studies.fit.target_file import parse_targets, read_target_file

EXAMPLE = Path(__file__).parents[3] / "config" / "fit_example.yaml"
FIT = {
    "parameters": {"regime": "drilling"},
    "unknowns": {
        "weight_on_bit": [4.0, 20.0],
        "contact_model": ["printed", "mode_shape"],
    },
    "points": 32,
    "rounds": 2,
    "repeat": 2,
    "targets": [
        {"figure": "reacting_force_mean", "window": 0.5, "value": 15.0, "tolerance": "4 %"},
        {"figure": "contact_force", "window": 0.5, "value": 1000.0, "tolerance": "4 %"},
        {
            "figure": "kinetic_energy_rate",
            "window": 0.5,
            "value": 20.0,
            "tolerance": "4 %",
            "hold_out": True,
        },
    ],
}


@pytest.fixture(autouse=True)
def few_particles(monkeypatch):
    monkeypatch.setattr(branches, "PARTICLES", 512)
    monkeypatch.setattr(rounds, "CANDIDATES", 4)
    monkeypatch.setattr(rounds, "CANDIDATE_RUNS", 4)


def known_drill(specification, folder, **values):
    """Return the specification with the figures of a drill of known parameters as targets."""
    held = FitFolder(folder, specification, 1, lambda runs: None)
    with held.held():
        figures = held.simulate("known", [values], 8, (9,))[0].mean(axis=0)
    targets = tuple(
        dataclasses.replace(target, value=float(value), tolerance=0.04 * float(value))
        for target, value in zip(specification.targets, figures, strict=True)
    )
    return dataclasses.replace(specification, targets=targets)


@pytest.fixture(scope="module")
def specification(tmp_path_factory):
    return known_drill(
        parse_targets(FIT),
        tmp_path_factory.mktemp("known") / "a",
        weight_on_bit=10.0,
        contact_model="mode_shape",
    )


def test_a_known_drill_is_found_with_its_choice_and_resumed(specification, tmp_path):
    counted = []
    fit = run_fit(specification, tmp_path / "fit", 2, counted.append)
    assert fit.best["contact_model"] == "mode_shape"
    interval = fit.identifiability.intervals["weight_on_bit"]
    assert 4.0 < interval.low < 10.0 < interval.high < 20.0
    assert fit.reached
    assert fit.misfit(True) < 3.0
    assert sum(counted) == fit.simulations
    write_fit(fit, tmp_path / "fit", "rpud fit targets.yaml --out DIR")
    again = run_fit(specification, tmp_path / "fit", 2)
    assert (again.simulations, again.kept) == (0, fit.simulations)
    assert again.best == fit.best
    assert again.shares.tobytes() == fit.shares.tobytes()

    parameters = read_parameter_file(tmp_path / "fit" / "parameters.yaml")
    drill = to_settings(parameters).configuration.parameters
    assert drill == specification.configuration(fit.best).parameters
    text = (tmp_path / "fit" / "parameters.yaml").read_text()
    assert [line.split(":")[0].strip() for line in text.splitlines() if "# fitted:" in line] == [
        "weight_on_bit",
        "contact_model",
    ]
    numbers = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert numbers["unknowns"]["weight_on_bit"]["low"] == interval.low
    page = (tmp_path / "fit" / "report.html").read_text()
    # The posterior of the unknown, and the targets.
    assert page.count('<svg role="img"') == 2
    shown = unknown_quantity(fit, "weight_on_bit")
    assert f"{shown.text(interval.low, unit=False)} to {shown.text(interval.high)}" in page
    assert "The model reaches all 2 targets that the fit used." in page
    assert "<script" not in page
    with pytest.raises(ParameterError, match=r"specification\.seed is 0 there"):
        run_fit(dataclasses.replace(specification, seed=1), tmp_path / "fit", 1)


def test_a_corner_shows_where_the_posterior_is(specification, tmp_path):
    fit = run_fit(specification, tmp_path / "fit", 2)
    random = np.random.default_rng(0)
    samples = {"weight_on_bit": random.normal(10.0, 0.01, 20_000)}
    samples["weight_on_bit"][0] = 19.0  # far away
    narrow = dataclasses.replace(
        fit,
        samples=samples,
        best={**fit.best, "weight_on_bit": 10.05},
        shares=np.zeros((20_000, 1)),
    )
    [[single]] = corner_rows(narrow)
    assert 9.9 < single.x.low < 9.97
    assert 10.05 < single.x.high < 10.1
    plot = target_plot(fit)
    low, high = axis_ends(plot, "x")
    for item in fit.comparisons:
        assert low < item.low / item.target.value < item.high / item.target.value < high
    assert dict(plot.y.columns)["target"][1].endswith(" kN")


def test_figures_out_of_reach_are_said_to_be(specification, tmp_path):
    far = dataclasses.replace(specification.targets[0], value=900.0, tolerance=1.0)
    asked = dataclasses.replace(specification, targets=(far,), rounds=1, choices={})
    fit = run_fit(asked, tmp_path / "fit", 1)
    assert not fit.reached
    silent = dataclasses.replace(asked, parameters={"vibration_amplitude": 0.0})
    no_impact = dataclasses.replace(specification.targets[1])
    with pytest.raises(FitError, match="of 32 points have all figures"):
        run_fit(dataclasses.replace(silent, targets=(no_impact,)), tmp_path / "still", 1)


@pytest.mark.extended
def test_intervals_hold_synthetic_drills_as_often_as_they_say(tmp_path):
    specification = read_target_file(EXAMPLE)
    short = tuple(
        dataclasses.replace(t, measure=dataclasses.replace(t.measure, end=0.5))
        for t in specification.targets
    )
    specification = dataclasses.replace(specification, points=128, targets=short)
    folder = FitFolder(tmp_path, specification, 2, lambda runs: None)
    with folder.held():
        proof = prove(folder, specification, 40)
    assert proof.drills == 40
    assert 0.8 <= proof.mean <= 1.0  # 160 intervals, of which those of one drill are correlated
    assert proof.chosen == pytest.approx(1.0)


class ClosedForm:
    """Folder whose simulations are two closed forms with chance."""

    simulated = kept = 0

    def simulate(self, job, points, repeat, seed):
        random = np.random.default_rng([*seed, 7])
        weight = np.array([point["weight_on_bit"] for point in points])
        loss = np.array([point["actuator_restitution"] for point in points])
        means = np.stack([2.0 + weight, weight**0.5 * (1.0 + loss**2)], axis=-1)
        return means[:, None] * np.exp(0.03 * random.standard_normal((len(points), repeat, 2)))


@pytest.mark.extended
def test_all_rounds_together_keep_the_truth():
    """Rounds that cut off a part of the posterior would hold it too rarely."""
    base = parse_targets(
        {
            "unknowns": {"weight_on_bit": [2.0, 20.0], "actuator_restitution": [0.0, 1.0]},
            "points": 32,
            "targets": [
                {"figure": name, "value": 1.0, "tolerance": "3 %"}
                for name in ("reacting_force_mean", "contact_force_mean")
            ],
        }
    )
    random = np.random.default_rng(6)
    held = []
    for seed in range(25):
        truth = random.random((1, 2))
        point = named_points(base, truth, {})[0]
        values = ClosedForm().simulate("", [point], 1, (seed, 99))[0, 0]
        values = values * np.exp(0.03 * random.standard_normal(2))
        targets = tuple(
            dataclasses.replace(target, value=float(value), tolerance=0.03 * float(value))
            for target, value in zip(base.targets, values, strict=True)
        )
        fit = fit_in(ClosedForm(), dataclasses.replace(base, targets=targets, seed=seed))
        for name, value in values_at(base, truth).items():
            interval = fit.identifiability.intervals[name]
            held.append(interval.low <= value[0] <= interval.high)
    assert 0.8 <= np.mean(held) <= 1.0
