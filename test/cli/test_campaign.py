"""`rpud test CAMPAIGN.yaml`: in parallel, resumable, the same every time, and nothing stays."""

import json
import os
import signal
import subprocess
import uuid
from pathlib import Path
from xml.etree import ElementTree

import pytest
from support import PATIENCE, Process, until

SUPERVISORS = Path(__file__).resolve().parents[1] / "testing"
CAMPAIGN = f"""\
system:
  command: python supervisor.py works --ros-args -r __ns:=/rpud
  folder: {SUPERVISORS}
  answers: [supervisor/heartbeat]
  hears: [reacting_force]
  answer_timeout: 60.0
duration: 0.6
scenarios:
  nominal: {{}}
  jammed: {{faults: [{{kind: free_mass_jammed, onset: 0.3}}]}}
expectations:
  - name: force
    requirement: SAFE-1
    expect: {{always: reacting_force.force < 500 N}}
  - name: never jammed
    requirement: SAFE-2
    expect: {{always: {{not: {{fault: free_mass_jammed}}}}}}
"""
MARK = "RPUD_TEST_CAMPAIGN"


@pytest.fixture
def campaign(tmp_path):
    file = tmp_path / "campaign.yaml"
    file.write_text(CAMPAIGN)
    return file


def rpud_test(*words):
    return subprocess.run(
        ["rpud", "test", *map(str, words)], capture_output=True, text=True, timeout=PATIENCE
    )


def marked(mark):
    """Return the numbers of the processes that have a mark in their environment."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}".encode() in (folder / "environ").read_bytes():
                found.append(int(folder.name))
        except OSError:
            continue
    return found


def test_an_interrupted_campaign_goes_on_and_gives_junit_json_and_a_page(campaign, tmp_path):
    out, mark = tmp_path / "out", uuid.uuid4().hex
    words = (campaign, "--out", out, "--repeat", "2")
    first = ("rpud", "test", *words, "--workers", "1")
    with Process(*first, env={**os.environ, MARK: mark}) as process:
        until(lambda: list(out.glob("runs/*/result.json")) or not process.running)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        assert process.wait() == 130, process.output
    until(lambda: not marked(mark))

    result = rpud_test(*words, "--workers", 2, "--json")
    assert result.returncode == 1, result.stderr
    printed = json.loads(result.stdout)
    assert printed["run"] == 3
    assert printed["repeatable"]
    outcomes = {each["requirement"]: each["outcome"] for each in printed["requirements"]}
    assert outcomes == {"system under test": "passed", "SAFE-1": "passed", "SAFE-2": "failed"}
    assert all((out / run["bag"] / "metadata.yaml").exists() for run in printed["runs"])
    suites = ElementTree.parse(out / "junit.xml").getroot()
    assert len(suites.findall("testsuite/testcase/failure")) == 2
    assert json.loads((out / "results.json").read_text())["digest"] == printed["digest"]
    assert "free_mass_jammed" in (out / "index.html").read_text()

    again = rpud_test(*words, "--only", "nominal")
    assert again.returncode == 0
    assert "requirements: 3 passed, 0 failed, 0 undecided" in again.stdout
    assert "2 runs: 0 flown, 2 kept" in again.stdout
    assert "each run gave one result in 2 repetitions" in again.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "a campaign needs --out DIR"),
        (("--out", "out", "--expect", "a.yaml"), "--expect is for bags"),
        (("--out", "out", "--workers", "0"), "--workers = 0 is outside its range [1, 100]"),
        (("--out", "out", "--only", "jamed"), "no run matches 'jamed'"),
    ],
)
def test_a_wrong_call_starts_nothing(campaign, tmp_path, words, message):
    words = [tmp_path / word if word == "out" else word for word in words]
    result = rpud_test(campaign, *words)
    assert result.returncode == 2
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_mistake_in_the_file_starts_nothing(campaign, tmp_path):
    campaign.write_text(CAMPAIGN.replace("kind: free_mass_jammed", "kind: free_mass_jamed"))
    result = rpud_test(campaign, "--out", tmp_path / "out")
    assert result.returncode == 2
    assert f"{campaign}:10: " in result.stderr
    assert "did you mean free_mass_jammed?" in result.stderr
    assert not (tmp_path / "out").exists()
