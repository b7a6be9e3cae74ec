"""Sweeps over cases and faults: their plan, their labels, their bags, and what is refused."""

import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_values import parse_specification
from support import refusal

import rpud_sim.bag
from rpud_sim.recorded.verify import verify
from rpud_sim.simulation.commands import Feed
from rpud_sim.studies.sweep.sweep import (
    SweepFolder,
    design_points,
    make_chunks,
    run_sweep,
    simulate,
)

SECOND = 1_000_000_000
CONTENT = {
    "design": "grid",
    "repeat": 2,
    "duration": 0.8,
    "onset": {"minimum": 0.2, "maximum": 0.3},
    "lasting": {"minimum": 0.2, "maximum": 0.4},
    "fixed": {"rock_model": "specific_energy"},
    "figures": ["drill_tool_impact_rate", "depth"],
    "cases": {"chalk": {"rock_specific_energy": 1e7}, "basalt": {"rock_specific_energy": 2e8}},
    "faults": [
        {"kind": "free_mass_jammed"},
        {"kind": "bias", "channel": "wrench", "severities": [5.0, 500.0]},
    ],
    "bags": ["wrench"],
}


def parsed(**entries):
    return parse_specification(CONTENT | entries)


def contents(folder):
    """Return the bytes of each file but the page, whose plots have numbers of this process."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != "report.html"]
    return {path.relative_to(folder): path.read_bytes() for path in files}


def by_name(specification):
    """Return each planned run and the seed of its point by the run's name."""
    points = design_points(specification)
    found = {}
    for number in range(specification.point_count):
        point = {name: values[number].item() for name, values in points.items()}
        for member in range(specification.repeat):
            run = specification.plan_run(number, point, member)
            found[run.name] = run, specification.point_seed(number, point)
    assert len(found) == specification.simulations
    return found


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return run_sweep(parsed(), tmp_path_factory.mktemp("sweep") / "out", 1)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32))
def test_each_run_is_planned_inside_its_intervals(seed):
    for run, first in by_name(parsed(seed=seed)).values():
        assert 0 <= run.seed < 2**32 > first >= 0
        if run.injection:
            assert 0.2 * SECOND <= run.onset <= 0.3 * SECOND
            assert 0.2 * SECOND <= run.injection.duration <= 0.4 * SECOND
        else:
            assert (run.faults, run.labels()) == ((), {})


def test_another_case_or_fault_changes_no_other_draw():
    before = by_name(parsed())
    after = by_name(
        parsed(
            cases={"flint": {"rock_specific_energy": 1e8}, **CONTENT["cases"]},
            faults=[{"kind": "lost_preload"}, *CONTENT["faults"]],
            repeat=3,
        )
    )
    assert len(after) > len(before) == 16
    assert {name: after[name] for name in before} == before
    other = by_name(parsed(seed=1))
    assert all(other[name][0].seed != run.seed for name, (run, _) in before.items())


def test_a_fault_without_an_end_lasts_to_the_end_of_the_run():
    content = {name: value for name, value in CONTENT.items() if name != "lasting"}
    runs = [run for run, _ in by_name(parse_specification(content)).values() if run.injection]
    assert len(runs) == 12
    assert all(run.injection.duration == 0 and run.labels()["clear"] is None for run in runs)


def test_every_bag_is_proved_and_its_ground_truth_is_the_label(made):
    rows = pq.read_table(made.folder / "simulations.parquet").to_pylist()
    assert len({row["bag"] for row in rows}) == len(rows) == 16
    for row in rows[8:]:
        bag = made.folder / row["bag"]
        with rpud_sim.bag.open(bag) as opened:
            last = opened.arrays("/rpud/faults")["faults"][-1]
            assert "/rpud/contact_force" not in opened.topics
        if row["fault"] == "healthy":
            assert (last, row["kind"], row["onset"], row["clear"]) == ([], None, None, None)
            continue
        (truth,) = last
        for name in ("kind", "channel", "magnitude"):
            assert truth[name] == row[name]
        for name in ("onset", "clear"):
            stamp = truth[name]
            assert stamp["sec"] * SECOND + stamp["nanosec"] == round(row[name] * SECOND)
        assert verify(bag).proved


def test_a_call_goes_on_after_a_kill_between_a_bag_and_its_chunk(made, tmp_path):
    specification = parsed()
    folder = SweepFolder(tmp_path / "out", specification)
    with folder.held():
        first, _ = make_chunks(specification, design_points(specification))
        folder.add(first, simulate(first))
        for left in ("basalt-bias-wrench-2-0-1", "basalt-bias-wrench-2-0-0.part"):
            (folder.path / "bags" / left).mkdir()
    again = run_sweep(specification, folder.path, 2)
    assert again.kept == first.count
    assert contents(folder.path) == contents(made.folder)


def test_commands_of_all_and_of_a_case_come_in_the_order_of_their_times(tmp_path):
    specification = parsed(
        fixed={"rock_model": "specific_energy", "feed_model": "arm", "drive_enabled": False},
        cases={"slow": {"commands": [{"time": 0.1, "feed": {"rate": 1e-4}}]}},
        commands=[
            {"time": 0.3, "drive": {"enabled": True}},
            {"time": 0.05, "feed": {"rate": 1e-3}},
        ],
        bags=["mount"],
        repeat=1,
        faults=[{"kind": "arm_slip"}],
    )
    planned = specification.planned({"case": "slow"})
    assert [each.time for each in planned] == [50_000_000, 100_000_000, 300_000_000]
    assert planned[1].action == Feed("rate", 1e-4)
    result = run_sweep(specification, tmp_path / "out", 1)
    bag = tmp_path / "out/bags/slow-arm_slip-1-0-0"
    with rpud_sim.bag.open(bag) as opened:
        rate = opened.arrays("/rpud/mount")["rate"]
        kinds = opened.arrays("/rpud/journal")["kind"].tolist()
    assert rate[[7, -1]] == pytest.approx([1e-3, 1e-4])
    assert kinds.count("feed") == 2
    assert verify(bag).proved
    assert result.failures == 0


FEED = [{"time": 0.1, "feed": {"rate": 1e-4}}]


@pytest.mark.parametrize(
    ("entries", "reason"),
    [
        (
            {"onset": {"minimum": 0.1, "maximum": 0.7}},
            "onset: the maxima of onset and lasting end after",
        ),
        ({"lasting": {"minimum": 0, "maximum": 0.1}}, "lasting: minimum = 0 s is below 1e-09 s"),
        ({"faults": []}, "onset and lasting are of faults, and there are none"),
        ({"faults": [{"kind": "choking", "severities": [0.5, 0.5]}]}, "stands twice; give"),
        ({"faults": [{"kind": "choking"}, {"kind": "choking", "severities": [0.1]}]}, "in one en"),
        (
            {"faults": [{"kind": "resonance_drift"}]},
            "cases.chalk: faults: resonance_drift-1: resonance_drift is not possible: it needs",
        ),
        ({"cases": {"a b": {}}}, "'a b' is no name of a case"),
        ({"cases": {"a": {"rock_model": "none"}}}, "cases.a: rock_model is among fixed as well"),
        ({"repeat": 100_000}, "8 points of 100000 simulations are more than 100000"),
        ({"commands": FEED}, "cases.chalk: command at 0.1 s: a feed cannot be commanded"),
        ({"commands": [{"time": 4.0, "weight_on_bit": 5.0}]}, "commands: time = 4 s is not below"),
    ],
)
def test_what_is_wrong_is_one_line(entries, reason):
    assert reason in refusal(lambda: parsed(**entries))
