"""Changes of a run, as the command line and a command file give them."""

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.changes import Changes, parameter_changes, parse_injections, read_commands


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: parameter_changes({"free_mas": 1}), "did you mean free_mass"),
        (lambda: parameter_changes({"free_mass": 1}), "free_mass cannot change during a run"),
        (lambda: parse_injections(["nois,channel=wrench"]), "did you mean noise"),
        (lambda: parse_injections(["noise,chanel=wrench"]), "did you mean channel"),
        (lambda: parse_injections(["noise,channel=wrench,magnitude=x"]), "is not a number"),
    ],
)
def test_a_change_that_cannot_be_is_named(make, reason):
    with pytest.raises(ParameterError, match=reason):
        make()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[]", "is not a scenario"),
        ("commands: 3", "commands = 3 is not a list"),
        ("commands: [{time: 1}]", "command 1: it needs a time, and weight_on_bit, drive or feed"),
        ("commands: [{time: -1, weight_on_bit: 2}]", "command 1: time = -1 s is outside"),
        ("commands: [{time: 1, weight_on_bit: -2}]", "weight_on_bit = -2 N is outside"),
        ("commands: [{time: 1, weigth: 2}]", "'weigth' is not one of"),
        ("commands: [{time: 1, drive: {enabled: maybe}}]", "'maybe' is not true or false"),
        ("commands: [{time: 1, drive: {frequency: .nan}}]", "drive frequency = nan"),
        ("comands: []", "'comands' is not one of seed, faults"),
    ],
)
def test_a_command_file_that_cannot_be_is_named(tmp_path, text, reason):
    (tmp_path / "commands.yaml").write_text(text)
    with pytest.raises(ParameterError, match=reason) as raised:
        read_commands(tmp_path / "commands.yaml")
    assert str(tmp_path / "commands.yaml") in str(raised.value)
    assert "\n" not in str(raised.value)


def test_nothing_differs_without_changes():
    assert Changes().empty
    assert not Changes(replaces_commands=True).empty
    assert (Changes() + Changes()).empty
