"""A report holds what the bag says: overview, motion, segments, energy, origin and verdict."""

import base64
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from frame_reader import decode
from recorded_bags import rewritten

import rpud_sim.bag
import rpud_sim.viewer
from rpud_sim.bag.own_records import VERDICT_RECORD, RunVerdict
from rpud_sim.messages.batch import LATEST
from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation import WeightOnBit
from rpud_sim.simulation.changes import Change
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.scenario_file import read_scenario
from rpud_sim.testing.artefacts import _reason
from rpud_sim.viewer.report import write_report

SECOND = 1_000_000_000
DURATION = 2.0
SCENARIO = "faults:\n  - {kind: free_mass_jammed, onset: 1.0, duration: 0.5}\n"
SHARE = Path(rpud_sim.viewer.__file__).parent / "share"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "scenario.yaml").write_text(SCENARIO)
    scenario = read_scenario(folder / "scenario.yaml")
    plan = Plan(Beginning(Settings(), faults=scenario), (Change(SECOND // 2, WeightOnBit(20.0)),))
    write_offline_bag(folder / "bag", plan, DURATION)
    return folder / "bag"


@pytest.fixture(scope="module")
def page(bag):
    write_report(bag, bag.parent / "report.html")
    return (bag.parent / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def frame(page):
    [frame] = re.findall('class="frame">([^<]*)<', page)
    return decode(base64.b64decode(frame))


def table(frame, title):
    [found] = [each for each in frame["report"]["tables"] if each["title"].startswith(title)]
    return [dict(zip(found["columns"], row, strict=False)) for row in found["rows"]]


def test_segments_lie_between_commands_and_faults(frame, bag):
    segments = table(frame, "segments")
    assert [each["begin [s]"] for each in segments] == ["0.000", "0.500", "1.000", "1.500"]
    assert ["20 N" in each["active commands"] for each in segments] == [False, True, True, True]
    assert [each["active faults"] for each in segments] == [
        *("none", "none", "free mass jammed", "none")
    ]
    with rpud_sim.bag.open(bag) as read:
        arrays = read.arrays("/rpud/contact_force")
        begin = read.start_time
    times = (arrays["header.stamp"] - begin) / SECOND
    counts, _ = np.histogram(times, [0.0, 0.5, 1.0, 1.5, 10.0])
    assert [int(each["impacts"]) for each in segments] == counts.tolist()
    first = arrays["peak_force"][times < 0.5]
    assert float(segments[0]["peak force: mean [kN]"]) == pytest.approx(
        first.mean() * 1e-3, rel=5e-3
    )


def test_motion_and_numbers_are_kept_over_the_whole_run_and_after_a_fault(frame):
    times = [each["time"] for each in frame["moments"]]
    assert len(times) == 12
    assert times[-1] == frame["now"]
    assert any(1.0 < time < 1.2 for time in times)
    for time, kept in zip(times, frame["moments"], strict=True):
        section, peak = kept["frame"]["section"], kept["frame"]["numbers"]["peak_force"]
        end = section["time"] + len(section["free_mass"]) * section["period"]
        assert end == pytest.approx(time, abs=0.02)
        assert peak["least"] <= peak["mean"] <= peak["greatest"]


def test_the_overview_has_every_quantity_that_a_plot_may_show(frame):
    shown = {
        layer["quantity"]
        for plot in frame["plots"]
        for choice in plot["choices"]
        for layer in choice["layers"]
        if layer["kind"] != "steps" and plot["id"] != "motion"
    }
    assert shown - {"contact_force"} <= frame["view"]["layers"].keys()
    force = frame["view"]["layers"]["reacting_force"]
    assert len(force["t"]) == len(force["mean"])
    assert (np.diff(force["t"]) > 0.0).all()


def test_the_verdict_of_a_test_is_in_the_report(bag, tmp_path):
    said = RunVerdict("test_mission.py::test_press", "failed", "7", ("[R1] calm: failed",), (1.25,))
    records = {VERDICT_RECORD: said.to_record()}
    rewritten(bag, tmp_path / "bag", topics={"/rpud/reacting_force"}, records=records)
    write_report(tmp_path / "bag", tmp_path / "out.html")
    [data] = re.findall('class="frame">([^<]*)<', (tmp_path / "out.html").read_text())
    frame = decode(base64.b64decode(data))
    report = frame["report"]
    failures = [each for each in frame["log"] if each["kind"] == "failure"]
    assert [(each["time"], each["text"]) for each in failures] == [(1.25, "failed")]
    assert not frame["moves"]  # no trajectory: the page shows no empty section
    assert (report["test"], report["verdict"], report["seed"]) == (said.test, "failed", "7")
    assert report["requirements"] == ["[R1] calm: failed"]


def test_without_scripts_a_report_has_verdict_and_numbers_and_says_why(page, bag, tmp_path):
    assert ">searching<" not in page
    static = page.partition('<section class="static"')[2].partition("</section>")[0]
    assert "Drill /rpud, 2" in static
    assert "they need scripts, which are blocked here" in static
    assert static.count("<table>") == 2
    assert "free mass jammed" in static
    said = RunVerdict("test_<b>", "failed", "7", ("[R1] calm: <i>",))
    records = {VERDICT_RECORD: said.to_record()}
    rewritten(bag, tmp_path / "bag", topics={"/rpud/reacting_force"}, records=records)
    write_report(tmp_path / "bag", tmp_path / "out.html")
    text = (tmp_path / "out.html").read_text()
    assert "<h2>failed \N{MIDDLE DOT} test_&lt;b&gt;</h2>" in text
    assert "<ul><li>[R1] calm: &lt;i&gt;</li></ul>" in text


def test_the_reason_of_a_failure_is_the_line_of_pytest():
    text = "drill = <rpud_sim.testing.drill.LockstepDrill object at 0x7f>\n\n>   assert 1 == 2\n"
    assert _reason(f"{text}E   assert 1 == 2\nE    +  more\n\ntest.py:3") == ["assert 1 == 2"]
    assert _reason("no such line\nat all") == ["no such line"]


def test_one_file_asks_nothing_of_others_and_runs_its_own_scripts_alone(page):
    [policy] = re.findall('http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert policy.count("sha256-") == 3
    assert not re.search(r"""(?:src|href)="(?!data:)""", page)


def test_modules_can_be_joined_for_their_names_are_unique():
    names = Counter()
    for module in SHARE.glob("*.js"):
        text = module.read_text(encoding="utf-8")
        assert len(re.findall(r"^import\b", text, re.MULTILINE)) == len(
            re.findall(r'^import .* from "\./[\w.]+";$', text, re.MULTILINE)
        )
        names.update(
            re.findall(r"^(?:export )?(?:class|function|const|let) (\w+)", text, re.MULTILINE)
        )
    assert len(names) > 50
    assert [name for name, count in names.items() if count > 1] == []


@pytest.mark.parametrize("latest", [True, False], ids=["the latest time", "times that fall"])
def test_a_report_ends_whatever_the_times_of_a_bag(bag, tmp_path, latest):
    with rpud_sim.bag.open(bag) as source, rpud_sim.bag.BagWriter(tmp_path / "odd") as odd:
        for summary in source.topics:
            odd.add_topic(summary.topic, summary.definition)
        for each in source.messages():
            logged = LATEST if latest else 10 * SECOND - each.log_time
            odd.write(each.topic, each.data, logged, LATEST if latest else each.publish_time)
    assert write_report(tmp_path / "odd", tmp_path / "report.html").messages > 0
