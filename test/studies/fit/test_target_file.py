"""Specifications of fits: what they hold, and one line for every mistake."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from plain_values import contents, parse_targets
from support import refusal

from rpud_sim.studies.fit.measures import UNITS
from rpud_sim.studies.fit.target_file import read_target_file

TARGET = {"figure": "reacting_force_mean", "value": 14.0, "tolerance": "5 %"}
FIT = {
    "parameters": {"regime": "drilling"},
    "unknowns": {"weight_on_bit": [2.0, 20.0]},
    "targets": [TARGET],
}


def changed(**entries):
    return {name: value for name, value in (FIT | entries).items() if value is not ...}


def target(**entries):
    return changed(targets=[{n: v for n, v in (TARGET | entries).items() if v is not ...}])


def unknown(name, content):
    return changed(unknowns={name: content})


def test_a_specification_holds_what_the_file_says(tmp_path):
    path = tmp_path / "targets.yaml"
    path.write_text(
        """
parameters: {regime: free}
unknowns:
  drill_tool_mass: {low: 1e-3, high: 2e-2, scale: log}
  contact_model: [printed, rayleigh]
  gravity: {values: [0.0, 9.81]}
seed: 3
phase_spread: 0.1
targets:
  - {figure: peak_force, statistic: quantile 0.05, window: 0.6, value: 400, tolerance: 20}
  - figure: contact_peak_force
    parameters: {regime: drilling}
    value: 1650
    tolerance: 2 %
    hold_out: true
  - {figure: kinetic_energy_rate, window: [1, 3], value: 20, tolerance: 5 %, runs: 4}
"""
    )
    found = read_target_file(path)
    assert (found.unknowns["drill_tool_mass"].minimum, found.seed) == (1e-3, 3)
    assert found.choices == {"contact_model": ("printed", "rayleigh"), "gravity": (0.0, 9.81)}
    assert len(found.combinations) == 4
    low, contact, rate = found.targets
    assert (low.measure.quantile, low.measure.end, low.tolerance) == (0.05, 0.6, 20.0)
    assert (contact.parameters, contact.hold_out) == ((("regime", "drilling"),), True)
    assert contact.tolerance == pytest.approx(33.0)
    assert (rate.measure.start, rate.measure.end, rate.runs) == (1.0, 3.0, 4)
    assert found.conditions == ((), (("regime", "drilling"),))
    drill = found.configuration({"gravity": 0.0}, contact.parameters).parameters
    assert (drill.regime, drill.gravity) == ("drilling", 0.0)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (None, "the file is not a mapping"),
        (changed(target=1), "'target' is not a key here; did you mean targets?"),
        (changed(unknowns={}), "unknowns holds no parameter with bounds"),
        (target(hold_out=True), "targets holds no target that the fit may use"),
        (changed(points=100), "points = 100 is no power of two"),
        (changed(parameters={"weight_on_bit": 1}), "weight_on_bit is among the param"),
        (unknown("gravity", {"low": 0, "high": 1, "scale": "log"}), "low = 0 has no logarithm"),
        (
            target(figure="reacting_force"),
            "figure = 'reacting_force' is not a figure; did",
        ),
        (target(value=0), "targets[0].tolerance = '5 %' of 0 is no tolerance above 0"),
        (target(statistic="mean"), "statistic: reacting_force_mean has none"),
        (
            target(figure="peak_force", statistic="median"),
            "statistic = 'median' is neither mean",
        ),
        (
            target(figure="torque"),
            "targets[0]: figure torque [N m] needs the parameter rotation_mo",
        ),
        (target(window=0), "targets[0].window = 0 begins at 0 s and ends at 0 s"),
        (changed(data=[{"csv": "missing.csv"}]), "missing.csv: No such file or directory"),
    ],
)
def test_a_mistake_is_one_line_with_entry_and_reason(content, complaint):
    assert complaint in refusal(parse_targets, content)


KEYS, ANYTHING = contents(
    [*FIT, *TARGET, "window", "statistic", "runs", "low", "high", "scale"],
    [*UNITS, "quantile 0.5", "5 %", "log", "drilling"],
)


@given(entries=st.dictionaries(KEYS, ANYTHING, max_size=3), content=ANYTHING)
def test_hostile_content_is_taken_or_refused_in_one_line(entries, content):
    for tried in (
        entries,
        FIT | entries,
        unknown("gravity", content),
        target(window=content, statistic=content),
        changed(targets=[TARGET | entries]),
    ):
        if not refusal(parse_targets, tried):
            assert all(item.tolerance > 0.0 for item in parse_targets(tried).targets)
