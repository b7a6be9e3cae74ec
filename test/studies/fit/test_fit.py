"""Fits as a whole: intervals that hold the truth, choices that differ, files that serve."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from plain_values import parse_targets

from rpud_sim.cli.studies import fit_lines
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.configuration import read_parameter_file, to_settings
from rpud_sim.studies.fit import fit as fits
from rpud_sim.studies.fit import posterior
from rpud_sim.studies.fit.fit import FitFolder, fit_in, run_fit, run_proof
from rpud_sim.studies.fit.measures import measure
from rpud_sim.studies.fit.posterior import Region
from rpud_sim.studies.fit.result import write_fit
from rpud_sim.studies.fit.target_file import read_target_file

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
        {"figure": "peak_force", "window": 0.5, "value": 1000.0, "tolerance": "4 %"},
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
def few_steps(monkeypatch):
    monkeypatch.setattr(posterior, "BURN_IN", 100)
    monkeypatch.setattr(posterior, "STEPS", 160)


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
    interval = fit.intervals["weight_on_bit"]
    assert 4.0 < interval.low < 10.0 < interval.high < 20.0
    assert not fit.missed
    assert fit.misfit(True) < 3.0
    assert sum(counted) == fit.simulations
    write_fit(fit, tmp_path / "fit", "rpud fit targets.yaml --out DIR")
    torn = tmp_path / "fit" / "simulations" / "best_00000.npy"
    torn.write_bytes(torn.read_bytes()[:-20])  # as by a power loss
    again = run_fit(specification, tmp_path / "fit", 2)
    assert (again.simulations, again.kept) == (fits.BEST_RUNS, fit.simulations - fits.BEST_RUNS)
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
    assert page.count('<svg role="img"') == 1  # the posterior of the unknown
    assert "The model reaches all 2 targets that the fit used." in page
    assert "<script" not in page
    with pytest.raises(ParameterError, match=r"specification\.seed is 0 there"):
        run_fit(dataclasses.replace(specification, seed=1), tmp_path / "fit", 1)


def test_the_default_drill_meets_the_targets_of_the_example():
    specification = read_target_file(Path(__file__).parents[3] / "config" / "fit_example.yaml")
    ours = Parameters()
    values = {name: getattr(ours, name) for name in specification.unknowns}
    [condition] = specification.conditions
    configuration = specification.configuration(values, condition)
    measures = [target.measure for target in specification.targets]
    found = measure(configuration, 0.0, measures)
    for target, value in zip(specification.targets, found, strict=True):
        assert value == pytest.approx(target.value, rel=0.08), target.measure.figure


@pytest.mark.extended
def test_intervals_hold_synthetic_drills_as_often_as_they_say(tmp_path):
    example = Path(__file__).parents[3] / "config" / "fit_example.yaml"
    specification = read_target_file(example)
    short = tuple(
        dataclasses.replace(t, measure=dataclasses.replace(t.measure, end=0.5))
        for t in specification.targets
    )
    specification = dataclasses.replace(specification, points=128, rounds=2, targets=short)
    proof = run_proof(specification, tmp_path, 2, 20)
    assert proof["drills"] + proof["refused"] == 20
    assert proof["refused"] <= 2
    assert proof["holds"]
    assert proof["true_choice_probability"] == pytest.approx(1.0)


class ClosedForm:
    """Folder whose simulations are closed forms with chance."""

    simulated = kept = 0

    def __init__(self, *figures, names=("weight_on_bit", "actuator_restitution")):
        self.figures = figures or (lambda w, e: 2.0 + w, lambda w, e: w**0.5 * (1.0 + e**2))
        self.names = names

    def simulate(self, job, points, repeat, seed):
        random = np.random.default_rng([*seed, 7])
        columns = [np.array([point[name] for point in points]) for name in self.names]
        means = np.stack([figure(*columns) for figure in self.figures], axis=-1)
        noise = random.standard_normal((len(points), repeat, len(self.figures)))
        return means[:, None] * np.exp(0.03 * noise)

    def specification(self, unknowns, **truth):
        """Return a fit to the figures of a drill."""
        values = [float(figure(*truth.values())) for figure in self.figures]
        figures = ("reacting_force_mean", "contact_force_mean")[: len(values)]
        return parse_targets(
            {
                "unknowns": dict(zip(self.names, unknowns, strict=True)),
                "points": 32,
                "targets": [
                    {"figure": name, "value": value, "tolerance": "3 %"}
                    for name, value in zip(figures, values, strict=True)
                ],
            }
        )


TWO = ([2.0, 20.0], [0.0, 1.0])


def outputs(fit, folder):
    """Return the text of every file of a fit, and what the command prints."""
    write_fit(fit, folder, "rpud fit targets.yaml --out DIR")
    files = [path.read_text() for path in folder.iterdir()]
    return "\n".join([*files, *fit_lines(fit)])


@pytest.mark.parametrize(("weight", "end"), [(20.0, "high"), (2.0, "low"), (20.5, "high")])
def test_at_a_bound_the_interval_ends_there_and_says_so(weight, end, tmp_path):
    drill = ClosedForm()
    fit = fit_in(drill, drill.specification(TWO, weight=weight, loss=0.5))
    interval = fit.intervals["weight_on_bit"]
    assert interval.at_bound == (end,)
    assert getattr(interval, end) == (20.0 if end == "high" else 2.0)
    assert interval.low <= fit.best["weight_on_bit"] <= interval.high
    assert fit.intervals["actuator_restitution"].at_bound == ()
    assert f"the {end} end is the bound: the true value may be beyond" in outputs(fit, tmp_path)


def test_a_posterior_that_the_last_region_cuts_off_has_no_interval(monkeypatch, tmp_path):
    monkeypatch.setattr(
        fits, "next_region", lambda branch: Region(np.array([0.0, 0.0]), np.array([0.5, 1.0]))
    )
    drill = ClosedForm()
    fit = fit_in(drill, drill.specification(TWO, weight=11.2, loss=0.5))
    assert not fit.missed
    assert fit.refusal.startswith("the last round's region cuts off the probable values of weight")
    text = outputs(fit, tmp_path)
    assert text.count("use more rounds") == 4
    assert "% interval" not in text
    assert not (tmp_path / "posterior.csv").exists()
    assert not fit.intervals


def test_amplitude_and_restitution_that_cannot_be_told_apart_are_a_ridge(tmp_path):
    drill = ClosedForm(
        lambda amplitude, loss: 1e5 * amplitude * (1.0 + loss),
        lambda amplitude, loss: (1e5 * amplitude * (1.0 + loss)) ** 2,
        names=("vibration_amplitude", "actuator_restitution"),
    )
    bounds = ([10e-6, 40e-6], [0.2, 1.0])
    fit = fit_in(drill, drill.specification(bounds, amplitude=20e-6, loss=0.6))
    (ridge,) = fit.ridges
    assert ridge.names == ("vibration_amplitude", "actuator_restitution")
    assert ridge.correlation < -0.9
    assert outputs(fit, tmp_path).count("vibration_amplitude falls as actuator_restitution") == 2
    assert fit.intervals["actuator_restitution"].identified == "no"


def test_no_output_of_a_fit_that_misses_its_targets_has_an_interval(tmp_path):
    drill = ClosedForm()
    asked = drill.specification(TWO, weight=11.0, loss=0.5)
    far = dataclasses.replace(asked.targets[0], value=90.0, tolerance=0.5)
    fit = fit_in(drill, dataclasses.replace(asked, targets=(far, asked.targets[1])))
    (missed,) = fit.missed
    assert missed.target == far
    text = outputs(fit, tmp_path)
    assert "not met: the model does not reach 1 of 2 targets" in text
    assert f"{90.0 - missed.mean:.4g} N too low, {-missed.deviation:.3g} standard dev" in text
    page = (tmp_path / "report.html").read_text()
    assert "Not met: the model does not reach 1 of 2 targets." in page
    assert "Posterior of the unknown" not in page
    assert not (tmp_path / "posterior.csv").exists()
    assert "fitted: no interval" in (tmp_path / "parameters.yaml").read_text()
    assert "% interval" not in text
