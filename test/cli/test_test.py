"""`rpud test` from the shell: verdicts, exit codes, and what is refused before a bag is read."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from altered_bags import altered, numbered
from sample_bags import write_offline_bag
from support import called

from rpud_sim.simulation import preset
from rpud_sim.verdicts import read_expectations

PASSED = "- {name: light, requirement: REQ-1, expect: {always: reacting_force.force < 1 kN}}"
FAILED = "- {name: heavy, expect: {always: reacting_force.force > 1 kN}}"
UNDECIDED = "- {name: long, expect: {always: reacting_force.force < 1 kN, within: 1 h}}"

SEQUENCE = 36  # place of the sequence in a contact force [bytes]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "bag"
    write_offline_bag(path, preset("drilling"), 0.2, 0.4)
    return path


@pytest.fixture
def rpud(capsys, tmp_path):
    """Call `rpud test` with expectations; give exit code, output and errors."""

    def call(bag, entries, *words):
        path = tmp_path / "expect.yaml"
        path.write_text("expectations:\n" + "\n".join(entries))
        return called(capsys, "test", bag, "--expect", path, *words)

    return call


def test_all_passed_gives_0(bag, rpud):
    code, out, err = rpud(bag, [PASSED])
    assert (code, err) == (0, "")
    assert out.splitlines()[1].split()[:3] == ["REQ-1", "light", "passed"]
    assert out.splitlines()[-1] == "1 passed, 0 failed, 0 undecided"


@pytest.mark.parametrize(("entries", "expected"), [([FAILED, UNDECIDED], 3), ([UNDECIDED], 1)])
def test_failed_gives_3_and_undecided_alone_1(bag, rpud, entries, expected):
    code, _, err = rpud(bag, [PASSED, *entries])
    assert (code, err) == (expected, "")


def test_json_and_junit_have_every_verdict(bag, rpud, tmp_path):
    code, out, _ = rpud(bag, [PASSED, FAILED, UNDECIDED], "--json", "--junit", tmp_path / "j.xml")
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
    assert heavy.find("failure").get("message").startswith("failed: broken at ")
    assert "before it is decided" in long.find("error").get("message")


@pytest.mark.parametrize(
    ("entry", "complaint"),
    [
        ("- {name: a, expect: reacting_forc.force < 1 N}", "did you mean reacting_force?"),
        ("- {name: a, expect: {onset: choked}}", "fault kind = 'choked' is unknown"),
        ("- {name: a, expect: reacting_force.force < 1 s}", "is in N, given 1 s"),
    ],
)
def test_a_wrong_expectation_gives_2_before_the_bag_is_read(rpud, tmp_path, entry, complaint):
    code, out, err = rpud(tmp_path / "no bag", [entry])
    assert (code, out) == (2, "")
    assert complaint in err
    assert err.startswith(f"rpud test: {tmp_path / 'expect.yaml'}:2: ")
    assert err.count("\n") == 1


def test_a_bag_that_is_missing_gives_1(rpud, tmp_path):
    code, _, err = rpud(tmp_path / "no bag", [PASSED])
    assert (code, err) == (1, f"rpud test: there is no bag at {tmp_path / 'no bag'}\n")


def test_impossible_values_in_a_bag_give_1(bag, rpud, tmp_path):
    def change(message):
        return [message.data[:SEQUENCE] + b"\xff" * 8 + message.data[SEQUENCE + 8 :]]

    altered(bag, tmp_path / "bag", numbered("contact_force", 2, change))
    code, out, err = rpud(tmp_path / "bag", ["- {name: a, expect: contact_force.energy < 1 J}"])
    assert (code, out) == (1, "")
    assert err.startswith("rpud test: contact_force: sequence: OverflowError")
    assert err.count("\n") == 1


def test_a_bag_without_expectations_gives_2(bag, capsys):
    line = "rpud test: a bag needs --expect FILE; see rpud test --help\n"
    assert called(capsys, "test", bag) == (2, "", line)


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
