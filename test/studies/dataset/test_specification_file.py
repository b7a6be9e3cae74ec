"""Specifications of data sets: what they mean, and what is refused in one line."""

import pytest
from sample_datasets import CONTENT, parsed

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.commands import Feed
from rpud_sim.simulation.faults import KINDS
from rpud_sim.studies.dataset import specification_file
from rpud_sim.studies.dataset.specification import DatasetError, window_starts
from rpud_sim.studies.dataset.specification_file import read_specification


def test_runs_are_counted_by_rock_severity_and_seed():
    assert parsed().run_count == 3 * (2 + 1 + 1)
    assert parsed(seeds=3, healthy=2).run_count == 3 * (3 * 3 + 2)


def test_a_fault_without_severities_has_its_default():
    (series,) = parsed(faults=[{"kind": "choking"}]).faults
    assert series.magnitudes == (KINDS["choking"].default,)


def test_the_word_physical_stands_for_every_physical_fault_that_the_drill_honours():
    specification = parsed(faults="physical")
    named = [series.kind for series in specification.faults]
    physical = [name for name, kind in KINDS.items() if kind.physical]
    assert sorted([*named, *specification.left_out]) == sorted(physical)
    assert "choking" in named
    assert set(specification.left_out) >= {"resonance_drift", "generator_lock_loss"}


def test_a_new_kind_of_fault_comes_in_by_itself(monkeypatch):
    monkeypatch.setattr(
        specification_file, "KINDS", {"invented": KINDS["choking"], "choking": KINDS["choking"]}
    )
    monkeypatch.setattr("rpud_sim.simulation.faults.KINDS", {**KINDS, "invented": KINDS["choking"]})
    kinds = [series.kind for series in parsed(faults="physical").faults]
    assert kinds == ["invented", "choking"]


def test_bags_hold_the_ground_truth_and_tables_do_not():
    specification = parsed(topics=["wrench"], only_in_bags=["trajectory"])
    assert specification.topics == ("wrench",)
    assert specification.bag_topics == ("faults", "journal", "status", "trajectory", "wrench")


def test_windows_fill_the_time_after_settling_and_none_is_cut_off():
    starts = window_starts(parsed(window={"length": 1.0, "stride": 0.5}))
    assert starts.tolist() == [500_000_000 * n for n in range(1, 7)]


def test_off_is_a_kind_of_fault_in_a_file(tmp_path):
    path = tmp_path / "spec.yaml"
    path.write_text(
        "duration: 4\nonset: {minimum: 1, maximum: 2}\n"
        "fixed: {drive_enabled: true}\n"
        "rocks: {a: {split: train}, b: {split: validation, gravity: 3.7},"
        " c: {split: test, gravity: 1.6}}\n"
        "faults: [{kind: off, channel: wrench}]\n"
    )
    specification = read_specification(path)
    assert specification.faults[0].kind == "off"
    assert specification.fixed["drive_enabled"] is True


ROCKS = CONTENT["rocks"]


@pytest.mark.parametrize(
    ("entries", "reason"),
    [
        ({"duratoin": 1}, "duratoin: is unknown; did you mean duration?"),
        ({"duration": float("nan")}, r"duration = nan s is outside its range \[0.1, 100000\] s"),
        ({"seeds": 1.5}, "seeds = 1.5 is not a whole number"),
        ({"seed": -1}, r"seed = -1 is outside its range \[0, 4.29497e\+09\]"),
        ({"onset": {"minimum": 0.1, "maximum": 1}}, "onset.minimum = 0.1 s is before settling"),
        ({"onset": {"minimum": 2, "maximum": 1}}, "onset: minimum 2 is above maximum 1"),
        ({"onset": {"minimum": 1, "maximum": 3.5}}, "onset.maximum . lasting.maximum = 4.5 s is"),
        ({"lasting": {"minimum": 0, "maximum": 1}}, "lasting.minimum = 0 s is outside its range"),
        ({"window": {"length": 5}}, "window.length = 5 s does not fit between settling = 0.5 s"),
        ({"window": {"stride": 0}}, r"window.stride = 0 s is outside its range"),
        ({"topics": ["wrnch"]}, "topics: 'wrnch' cannot be here; did you mean wrench?"),
        ({"topics": ["faults"]}, "topics: 'faults' cannot be here"),
        ({"rocks": {k: ROCKS[k] for k in ("chalk", "basalt")}}, "the split validation has no rock"),
        ({"rocks": {**ROCKS, "flint": ROCKS["chalk"]}}, "rocks.flint: has the parameters of"),
        ({"rocks": {**ROCKS, "a b": {"split": "test"}}}, "rocks.a b: is not a name of a rock"),
        ({"rocks": {**ROCKS, "a": {}}}, "rocks.a.split: is missing"),
        ({"rocks": {**ROCKS, "a": {"split": "tset"}}}, "rocks.a.split: 'tset' is not one of"),
        (
            {"rocks": {**ROCKS, "a": {"split": "test", "rock_specific_energy": -1.0}}},
            r"rocks.a: rock_specific_energy = -1 J/m\^3 is outside its range",
        ),
        (
            {"rocks": {**ROCKS, "a": {"split": "test", "rock_model": "none"}}},
            "rocks.a.rock_model: stands twice, once for all runs",
        ),
        ({"fixed": {"scenario": "a.yaml"}}, "fixed.scenario: is unknown"),
        ({"varied": {"rock_model": {}}}, "varied.rock_model: stands twice"),
        ({"varied": {"regime": {}}}, "varied.regime: is not a number that can be drawn"),
        ({"faults": "all"}, "faults: 'all' is neither a list nor the word physical"),
        ({"faults": [{"kind": "chocking"}]}, "faults: entry 1: fault kind = 'chocking' is not"),
        (
            {"faults": [{"kind": "choking", "severities": [0.5, 2.0]}]},
            r"faults: entry 1: magnitude of choking = 2 is outside its range \(0, 1\]",
        ),
        ({"faults": [{"kind": "choking", "severities": [0.5, 0.5]}]}, "hold a magnitude twice"),
        ({"faults": [{"kind": "choking"}, {"kind": "choking"}]}, "entry 2: choking stands there"),
        (
            {"faults": [{"kind": "resonance_drift"}]},
            "entry 1: rock chalk: resonance_drift cannot be honoured: it needs actuator_model",
        ),
        ({"seeds": 10_000, "healthy": 10_000}, r"runs = 120000 is outside its range \[1, 100000\]"),
    ],
)
def test_what_is_wrong_is_one_line(entries, reason):
    with pytest.raises((DatasetError, ParameterError), match=reason) as error:
        parsed(**entries)
    assert "\n" not in str(error.value)


FED = {"fixed": {"rock_model": "specific_energy", "feed_model": "arm"}}


def test_commands_have_the_syntax_of_a_command_file():
    commands = parsed(
        **FED,
        commands=[
            {"time": 2.0, "drive": {"enabled": "false"}},
            {"time": 0.5, "feed": {"rate": 2e-4}},
        ],
    ).commands
    assert [each.delay for each in commands] == [500_000_000, 2_000_000_000]
    assert commands[0].change == Feed("rate", 2e-4)
    assert parsed().commands == ()


@pytest.mark.parametrize(
    ("entries", "reason"),
    [
        ({"commands": {"time": 1.0}}, "commands: .* is not a list"),
        ({"commands": [{"time": 1.0}]}, "commands: command 1: it needs a time, and"),
        (
            {"commands": [{"time": 1.0, "feed": {"rate": 1e-4}}]},
            "rocks.chalk: command at 1 s: a feed cannot be commanded with feed_model = none",
        ),
        (
            {**FED, "commands": [{"time": 1.0, "weight_on_bit": 5.0}]},
            "weight_on_bit cannot be commanded with feed_model = arm",
        ),
        (
            {**FED, "commands": [{"time": 1.5, "feed": {"rate": 0.5}}]},
            "command at 1.5 s: feed rate = 0.5 m/s is outside its range",
        ),
        (
            {"commands": [{"time": 4.0, "weight_on_bit": 5.0}]},
            "commands: time = 4 s is not below duration = 4 s",
        ),
        (
            {
                "fixed": {"nominal_voltage": 1.0},
                "commands": [{"time": 1.0, "drive": {"voltage": 900.0}}],
            },
            "command at 1 s: .*amplitude",
        ),
    ],
)
def test_commands_that_a_run_would_refuse_are_refused(entries, reason):
    with pytest.raises(DatasetError, match=reason):
        parsed(**entries)
