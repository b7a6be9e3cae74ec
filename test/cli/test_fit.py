"""`rpud fit`: what it prints, writes and refuses."""

import json
import re

import pytest
import yaml
from support import called, rpud

TARGETS = {
    "parameters": {"regime": "drilling"},
    "unknowns": {"weight_on_bit": [4.0, 20.0]},
    "points": 16,
    "rounds": 1,
    "repeat": 2,
    "targets": [
        {"figure": "reacting_force_mean", "window": 0.5, "value": 15.0, "tolerance": "5 %"},
        {
            "figure": "contact_force_mean",
            "window": 0.5,
            "value": 5e3,
            "tolerance": "20 %",
            "hold_out": True,
        },
    ],
}


@pytest.fixture(scope="module")
def targets(tmp_path_factory):
    path = tmp_path_factory.mktemp("targets") / "targets.yaml"
    path.write_text(yaml.safe_dump(TARGETS))
    return path


@pytest.fixture(scope="module")
def made(targets):
    folder = targets.parent / "fit"
    done = rpud("fit", targets, "--out", folder, "--workers", 1)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def test_a_fit_prints_intervals_and_targets_and_writes_its_files(made):
    folder, printed = made
    heading, unknown, _, target, held_out, misfit, _ = printed.splitlines()
    assert heading.split("  ")[0] == "parameter"
    assert re.match(r"weight_on_bit  [\d.]+ N +[\d.]+ to [\d.]+ N +0\.\d\d$", unknown.rstrip())
    assert target.startswith("reacting_force_mean, 0 to 0.5 s  ")
    assert "(held out)" in held_out
    assert misfit.startswith("misfit ")
    files = {"fit.json", "manifest.json", "parameters.yaml", "posterior.csv", "report.html"}
    assert {path.name for path in folder.iterdir()} == {*files, "simulations"}


def test_a_fit_that_misses_a_target_ends_with_code_three(capsys, tmp_path):
    path = tmp_path / "targets.yaml"
    far = TARGETS["targets"][0] | {"value": 500.0}
    path.write_text(yaml.safe_dump(TARGETS | {"targets": [far]}))
    options = ("fit", path, "--out", tmp_path / "fit", "--workers", 1)
    code, printed, _ = called(capsys, *options)
    first, missed, *_ = printed.splitlines()
    assert code == 3
    assert first == ("not met: the model does not reach 1 of 1 targets; there are no intervals")
    assert missed.startswith("reacting_force_mean, 0 to 0.5 s: 4")
    assert missed.endswith(" standard deviations")
    code, printed, _ = called(capsys, *options, "--json")
    content = json.loads(printed)
    assert (code, content["reached"], content["missed"]) == (
        3,
        False,
        ["reacting_force_mean, 0 to 0.5 s"],
    )
    assert set(content["unknowns"]["weight_on_bit"]) == {"best", "unit"}
    assert (content["run"], content["kept"]) == (0, content["simulations"])
    numbers = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert numbers == {name: content[name] for name in numbers}


@pytest.mark.extended
def test_a_proof_counts_the_intervals(targets, made):
    folder, _ = made
    done = rpud("fit", targets, "--out", folder, "--prove", 20, "--json")
    proof = json.loads(done.stdout)
    assert proof["drills"] + proof["refused"] == 20
    assert list(proof["covered"]) == ["weight_on_bit"]
    assert done.returncode == (0 if proof["holds"] else 1)
    assert json.loads((folder / "proof.json").read_text()) == proof


@pytest.mark.parametrize(
    ("entries", "complaint"),
    [
        ({"unknowns": {"weight_on_bt": [1, 2]}}, "did you mean weight_on_bit?"),
        ({"seed": 9}, "is of another fit: specification.seed is 0 there and 9 here"),
    ],
)
def test_a_mistake_is_one_line_and_code_two(capsys, made, tmp_path, entries, complaint):
    folder, _ = made
    path = tmp_path / "targets.yaml"
    path.write_text(yaml.safe_dump(TARGETS | entries))
    code, output, errors = called(capsys, "fit", path, "--out", folder)
    assert (code, output, errors.count("\n")) == (2, "", 1)
    assert errors.startswith("rpud fit: ")
    assert complaint in errors
