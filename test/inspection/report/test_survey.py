"""What a report finds in a bag: segments, figures, faults, times, and what is missing."""

import numpy as np
import pytest
from inspection.report.read_page import DURATION, Page, surveyed
from sample_bags import SECOND, START, serialized

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.losses import RECORD_NAME, Losses, losses_to_record
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST
from rpud_sim.bag.manifest import Manifest
from rpud_sim.inspection.report import rows
from rpud_sim.inspection.report.bag_report import render
from rpud_sim.inspection.report.run_marks import run_marks
from rpud_sim.pages.plot import GAP
from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario import read_scenario
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics


def test_segments_lie_between_commands_and_faults(seen, page):
    found = seen.periods["/rpud"].all
    assert [round(period.begin, 6) for period in found] == [0.0, 0.25, 0.75, 0.9]
    assert [period.faults for period in found] == ["", "bias wrench", "", "lost_preload"]
    assert {period.commands for period in found} == {"weight on bit 8 N"}
    topic = seen.topics["/rpud/contact_force"]
    assert sum(period.impacts for period in found) == topic.find("peak_force").count
    assert sum(period.energy for period in found) == pytest.approx(topic.find("energy").total)
    assert found[-1].end == pytest.approx(DURATION, abs=0.01)
    assert "0.250000 0.750000 weight on bit 8 N bias wrench" in page.text


def test_the_figures_are_those_of_the_simulation(seen, drilled):
    simulation = Simulation(
        preset("drilling"), 0.0, read_scenario(drilled.parent / "scenario.yaml")
    )
    statistics = Statistics()
    statistics.add(simulation.advance_to(SECOND))
    figures = statistics.figures()
    shown = {name: value for name, value, _ in rows.impact_rows(seen, "/rpud/contact_force")}
    shown |= {name: value for name, value, _ in rows.energy_rows(seen, "/rpud/contact_force")}
    exact = ("impact_velocity_mean", "contact_force_mean", "contact_force_max")
    for name in (*exact, "contact_duration_mean"):
        assert float(shown[name].split()[0]) == pytest.approx(figures[name], rel=1e-3), name
    # Those are of the whole run, these of the intervals and samples in the bag.
    for name in ("drill_tool_impact_rate", "actuator_impact_rate", "kinetic_energy_rate"):
        assert float(shown[name].split()[0]) == pytest.approx(figures[name], rel=0.02), name
    force = float(shown["reacting_force_mean"].split()[0])
    assert force == pytest.approx(figures["reacting_force_mean"], rel=0.02)
    assert shown["drill_tool_impacts"] == str(simulation.impact_count)
    assert shown["drill_tool_impacts_missing"] == "0"
    assert int(shown["events"]) == pytest.approx(figures["events"], abs=2)


def test_the_spectrum_shows_the_vibration(seen):
    waveform = seen.waveforms["/rpud/waveform"]
    frequencies, densities = waveform.spectrum.density(waveform.rate)
    high = frequencies > 5000.0
    actuator = densities[1][high]
    assert frequencies[high][np.argmax(actuator)] == pytest.approx(16_000.0, abs=4.0)
    # A sine's power is half its amplitude squared.
    near = np.abs(frequencies - 16_000.0) < 50.0
    power = densities[1][near].sum() * (frequencies[1] - frequencies[0])
    assert power == pytest.approx(preset("drilling").vibration_amplitude ** 2 / 2, rel=0.01)


def test_faults_have_their_times(seen, page):
    found = rows.fault_rows(seen.faults["/rpud/faults"])
    assert [(kind, onset, clear) for _, kind, _, _, onset, clear in found] == [
        ("bias", "0.250000", "0.750000"),
        ("lost_preload", "0.900000", "lasts"),
    ]
    assert "lost_preload physics 0.5 0.900000 lasts" in page.text


def test_timing_is_that_of_the_bag(seen):
    table = {row[0]: row for row in rows.timing_rows(seen)}
    name, messages, lost, missing, median, _, greatest, late, *_ = table["/rpud/reacting_force"]
    assert (messages, lost, missing, late) == ("100", "0", "", "0")
    assert float(median) == pytest.approx(10.0, rel=0.01)
    assert float(greatest) == pytest.approx(10.0)
    assert table["/rpud/waveform"][3] == "0"
    assert name == "/rpud/reacting_force"


def test_lateness_and_gaps_show(drilled, tmp_path):
    """As a recorder would have it: late messages, and one of the impacts lost."""
    late = 2_000_000
    with rpud_sim.bag.open(drilled) as source, BagWriter(tmp_path / "bag") as bag:
        for summary in source.topics:
            bag.add_topic(summary.topic, summary.definition)
        count = 0
        for message in source.messages():
            count += message.topic == "/rpud/contact_force"
            if message.topic == "/rpud/contact_force" and count == 100:
                continue
            time = START + message.log_time + (late if count > 200 else 0)
            bag.write(message.topic, message.data, time, time)
        losses = {"/rpud/contact_force": Losses(1, 0)}
        bag.add_record(RECORD_NAME, losses_to_record(losses))
        manifest = Manifest(
            "/rpud/drill_node", 0, {"seed": 7, "gravity": 9.81}, "", ("rpud", "record")
        )
        bag.add_record(MANIFEST, manifest.to_record())
    seen = surveyed(tmp_path / "bag")
    row = {row[0]: row for row in rows.timing_rows(seen)}["/rpud/contact_force"]
    assert row[2:4] == ("1", "1")
    [gap] = [mark for mark in run_marks(seen) if mark.kind == GAP]
    assert gap.text == "missing: /rpud/contact_force (1)"
    assert 0.0 < gap.time < gap.end < DURATION
    assert float(row[9]) == pytest.approx(2.0, abs=0.1)  # jitter [ms]
    assert rows.parameter_rows(seen) == [("gravity", "9.81"), ("seed", "7")]
    [run] = rows.run_rows(seen)
    assert {("drill", "/rpud/drill_node"), ("seed", "7"), ("command", "rpud record")} <= set(run)


def test_a_status_from_before_the_bag_shifts_no_chart(drilled, tmp_path):
    """As a recorder gets a latched topic: its first message is as old as it is."""
    age = SECOND // 2
    with rpud_sim.bag.open(drilled) as source, BagWriter(tmp_path / "bag") as bag:
        for summary in source.topics:
            bag.add_topic(summary.topic, summary.definition)
        kept = {}
        for message in source.messages():
            if message.log_time < age:
                if message.topic == "/rpud/status":
                    kept[message.topic] = message
                continue
            for old in kept.values():
                bag.write(old.topic, old.data, START, START)
            kept = {}
            time = START + message.log_time - age
            bag.write(message.topic, message.data, time, time)
    seen = surveyed(tmp_path / "bag")
    assert seen.span == pytest.approx(DURATION - age / SECOND, abs=0.02)
    ends = [
        seen.topics[name].end
        for name in ("/rpud/status", "/rpud/waveform", "/rpud/nodal_plane", "/rpud/contact_force")
    ]
    assert ends == pytest.approx([DURATION - age / SECOND] * 4, abs=0.02)


def test_types_that_only_have_the_names_of_ours_are_no_failure(tmp_path):
    fields = ("energy", "peak_force", "event", "duration", "time", "sequence", "real_time_factor")
    texts = "".join(f"string {field}\n" for field in fields) + "string[] faults\nstring header\n"
    stamped = (
        "pkg/Header header\nfloat64 time\nuint8[2] sequence\nstring[] faults\nfloat32 energy\n"
        f"float32 peak_force\n{'=' * 80}\nMSG: pkg/Header\nbuiltin_interfaces/Time stamp\n"
        f"{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
    stamp = {"stamp": {"sec": 1, "nanosec": 0}}
    values = {"time": 1.0, "sequence": np.zeros(2, np.uint8), "faults": ["a"], "energy": 1.0}
    contents = {
        texts: {**dict.fromkeys(fields, "a"), "faults": ["a"], "header": "b"},
        stamped: {"header": stamp, "peak_force": 2.0, **values},
    }
    ours = ("ContactForce", "Waveform", "Trajectory", "Faults", "JournalEntry", "Status")
    with BagWriter(tmp_path / "bag") as bag:
        for kind in ours:
            for number, (definition, content) in enumerate(contents.items()):
                topic = Topic(f"/{kind.lower()}{number}", f"rpud_msgs/msg/{kind}")
                bag.add_topic(topic, definition)
                data = serialized(topic.type, definition, content)
                for time in (START, START + 1):
                    bag.write(topic.name, data, time, time)
    seen = surveyed(tmp_path / "bag")
    assert seen.left_out == {}
    assert seen.faults["/faults1"].unlisted == 2
    assert "drill_tool_impacts 2" in Page(render(seen)).text


def test_a_drill_that_is_faster_than_the_recorder_s_clock_is_shown_to_its_end(drilled, tmp_path):
    with rpud_sim.bag.open(drilled) as source, BagWriter(tmp_path / "bag") as bag:
        for summary in source.topics:
            bag.add_topic(summary.topic, summary.definition)
        for message in source.messages():
            bag.write(message.topic, message.data, START + message.log_time // 10, START)
    seen = surveyed(tmp_path / "bag")
    assert seen.duration == pytest.approx(0.1 * DURATION)
    assert seen.span == pytest.approx(DURATION, rel=0.05)
    assert seen.topics["/rpud/waveform"].timeline.jumps == 0
    rate = float(rows.impact_rows(seen, "/rpud/contact_force")[2][1].split()[0])
    assert 300.0 < rate < 500.0  # by the stamps
