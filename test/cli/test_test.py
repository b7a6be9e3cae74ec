"""`rpud test` from the shell: verdicts, exit codes, and what is refused before a bag is read."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from support import called

from rpud_sim.verdicts import read_expectations

PASSED = "- {name: light, requirement: REQ-1, expect: {always: reacting_force.force < 1 kN}}"
FAILED = "- {name: heavy, expect: {always: reacting_force.force > 1 kN}}"
UNDECIDED = "- {name: long, expect: {always: reacting_force.force < 1 kN, within: 1 h}}"


@pytest.fixture
def rpud(capsys, tmp_path):
    """Call `rpud test` with expectations; give exit code, output and errors."""

    def call(bag, entries, *words):
        path = tmp_path / "expect.yaml"
        path.write_text("expectations:\n" + "\n".join(entries))
        return called(capsys, "test", bag, "--expect", path, *words)

    return call


def test_all_passed_gives_0(drill_bag, rpud):
    code, out, err = rpud(drill_bag, [PASSED])
    assert (code, err) == (0, "")
    assert out.splitlines()[1].split()[:3] == ["REQ-1", "light", "passed"]
    assert out.splitlines()[-1] == "1 passed, 0 failed, 0 undecided"


@pytest.mark.parametrize(("entries", "expected"), [([FAILED, UNDECIDED], 3), ([UNDECIDED], 1)])
def test_failed_gives_3_and_undecided_alone_1(drill_bag, rpud, entries, expected):
    code, _, err = rpud(drill_bag, [PASSED, *entries])
    assert (code, err) == (expected, "")


def test_json_and_junit_have_every_verdict(drill_bag, rpud, tmp_path):
    code, out, _ = rpud(
        drill_bag, [PASSED, FAILED, UNDECIDED], "--json", "--junit", tmp_path / "j.xml"
    )
    content = json.loads(out)
    assert code == 3
    assert content["counts"] == {"passed": 1, "failed": 1, "undecided": 1}
    assert content["runs"] == 1
    assert [each["outcome"] for each in content["verdicts"]] == ["passed", "failed", "undecided"]
    [suite] = ElementTree.parse(tmp_path / "j.xml").getroot()
    assert {name: suite.get(name) for name in ("tests", "failures", "errors")} == {
        "tests": "3",
        "failures": "1",
        "errors": "1",
    }
    light, heavy, long = suite
    properties = {each.get("name"): each.get("value") for each in light.iter("property")}
    assert properties["requirement"] == "REQ-1"
    assert properties["margin"].endswith(" N")
    message = heavy.find("failure").get("message")
    assert message.startswith("failed: reacting_force.force was ")
    assert message.endswith("; required: always(reacting_force.force > 1 kN)")
    assert "before it is decided" in long.find("error").get("message")


def test_a_file_that_has_no_folder_is_refused_before_the_bag_is_read(rpud, tmp_path):
    file = tmp_path / "missing" / "j.xml"
    code, out, err = rpud(tmp_path / "no bag", [PASSED], "--junit", file)
    assert (code, out) == (1, "")
    assert err == f"rpud test: {file}: there is no folder {file.parent}\n"


def test_the_example_is_understood():
    path = Path(__file__).resolve().parents[2] / "config" / "expectations.yaml"
    assert [each.requirement for each in read_expectations(path)] == [
        "LOAD-1",
        "LOAD-2",
        "COMMAND-1",
        "FAULT-1",
        "FAULT-2",
        "FAULT-3",
    ]
