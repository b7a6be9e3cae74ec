"""`rpud compare` from the shell: what it prints, and its exit codes."""

import json

import pytest
from altered_bags import altered
from sample_bags import write_offline_bag

from rpud_sim.simulation import preset

DRILLING = preset("drilling")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    write_offline_bag(folder / "a", DRILLING, 1.0, 0.1)
    write_offline_bag(folder / "other", DRILLING, 1.0, 0.85)
    write_offline_bag(folder / "heavier", DRILLING.replace(weight_on_bit=40.0), 1.0, 0.6)
    return folder


def test_equal_bits_are_said(made, rpud):
    code, out, err = rpud("compare", made / "a", made / "a")
    assert (code, err) == (0, "")
    assert "\nB: equal bits: all " in out
    assert out.endswith("\nequal bits: the runs are the same\n")


@pytest.mark.extended
def test_a_difference_ends_with_3_and_a_page_is_written(made, tmp_path, rpud):
    page = tmp_path / "compare.html"
    code, out, err = rpud("compare", made / "a", made / "heavier", "--out", page)
    assert (code, err) == (3, "")
    lines = out.splitlines()
    assert lines[0].startswith("A  a: /rpud, run 1 of 1, ")
    assert any(line.split() == ["weight_on_bit", "8", "40", "N"] for line in lines)
    assert any(line.startswith("B: bits differ from A from 0.0") for line in lines)
    assert any(line.startswith("reacting force ") and "differs" in line for line in lines)
    assert "metrics differ" in lines[-2]
    assert lines[-1] == f"page: {page}"
    text = page.read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    assert "http://" not in text.partition("<script")[0]


def test_no_difference_ends_with_0_and_json_is_one_object(made, rpud):
    words = ("--quantity", "peak_force", "--quantity", "impact_rate", "--json")
    code, out, err = rpud("compare", made / "a", made / "other", *words)
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert (found["equal_bits"], found["differs"], found["undecided"]) == (False, False, False)
    assert {each["quantity"] for each in found["metrics"]} == {"peak_force", "impact_rate"}


def test_a_tolerance_has_three_ends(made, rpud):
    only = ("--quantity", "contact_duration", "--quantity", "impact_velocity", "--tolerance")
    code, out, _ = rpud("compare", made / "a", made / "other", *only, "80")
    assert code == 0
    assert out.endswith("all 4 metrics are within 80 %\n")
    code, out, _ = rpud("compare", made / "a", made / "other", *only, "0.01")
    assert code == 1
    assert "not decided" in out
    force = ("--quantity", "reacting_force", "--tolerance", "20")
    code, out, _ = rpud("compare", made / "a", made / "heavier", *force)
    assert code == 3
    assert "metrics differ by more than 20 %" in out


def test_damage_is_reported_and_ends_with_3(made, tmp_path, rpud):
    def change(message):
        broken = message.topic == "/rpud/reacting_force" and message.log_time == 10**9 // 2
        return [message.data[:20] if broken else message.data]

    path = altered(made / "other", tmp_path / "broken", change)
    code, _, err = rpud("compare", made / "a", path)
    assert code == 3
    assert err.startswith("rpud compare: broken: left out /rpud/reacting_force: 1 of its messages")
    assert err.count("\n") == 1
