"""`rpud sensitivity`: its tables, its file, and its exit codes."""

import json
import subprocess

import pytest

STUDY = """
samples: 4
settling: 0
duration: 0.2
inputs: {free_mass: {minimum: 4.5e-3, maximum: 5.5e-3, source: last digit}}
"""


@pytest.fixture
def rpud(tmp_path):
    def call(*words):
        return subprocess.run(
            ["rpud", "sensitivity", *words],
            capture_output=True,
            text=True,
            timeout=110,
            check=False,
            cwd=tmp_path,
        )

    (tmp_path / "study.yaml").write_text(STUDY)
    return call


def test_it_prints_each_figure_and_writes_the_same_numbers_to_a_file(rpud, tmp_path):
    shown = rpud("study.yaml", "--out", "study.json")
    assert shown.returncode == 0, shown.stderr
    content = json.loads((tmp_path / "study.json").read_text())
    for name, figure in content["figures"].items():
        assert f"{name}: share of the variance [95 % interval]" in shown.stdout
        assert f"{figure['mean']:.4g}" in shown.stdout
    assert content["specification"]["inputs"]["free_mass"]["source"] == "last digit"
    printed = rpud("study.yaml", "--json")
    assert json.loads(printed.stdout) == content


@pytest.mark.parametrize(
    ("words", "code", "line"),
    [
        (["none.yaml"], 2, "rpud sensitivity: none.yaml: No such file or directory\n"),
        (
            ["study.yaml", "--out", "none/study.json"],
            1,
            "rpud sensitivity: --out none/study.json: its folder does not exist\n",
        ),
        (["study.yaml", "--out", "."], 1, "rpud sensitivity: --out .: is a folder\n"),
    ],
)
def test_a_mistake_is_one_line(rpud, words, code, line):
    result = rpud(*words)
    assert (result.returncode, result.stderr) == (code, line)
