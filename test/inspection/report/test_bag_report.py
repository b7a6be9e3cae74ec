"""The page tells what is in the bag, needs nothing beside it, and believes no name."""

import html.parser
import resource
import subprocess
import sys

import numpy as np
import pytest
from sample_bags import (
    SECOND,
    START,
    STRING_DEFINITION,
    TALK,
    serialized,
    write_bag,
    write_commanded_bag,
    write_everything,
    write_offline_bag,
)

import rpud_sim.bag
from bench.long_bag import long_waveform
from rpud_sim.bag import BagError, BagWriter, Topic
from rpud_sim.bag.losses import RECORD_NAME, Losses, losses_to_record
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST
from rpud_sim.bag.manifest import Manifest
from rpud_sim.inspection.report import rows
from rpud_sim.inspection.report.bag_report import ReportError, render, write_report
from rpud_sim.inspection.report.run_marks import run_marks
from rpud_sim.inspection.report.running_statistics import Envelope
from rpud_sim.inspection.report.survey import survey
from rpud_sim.pages.embedding import bokeh_script, plots_script
from rpud_sim.pages.plot import COMMAND, GAP
from rpud_sim.simulation import WeightOnBit, preset
from rpud_sim.simulation.scenario import read_scenario
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

DURATION = 1.0
SCENARIO = """
faults:
  - {kind: bias, channel: wrench, magnitude: 100, onset: 0.25, duration: 0.5}
  - {kind: lost_preload, magnitude: 0.5, onset: 0.9}
"""
SECTIONS = (
    "run", "impacts", "segments", "force", "energy", "spectra", "series", "timing", "faults",
)  # fmt: skip


class Page(html.parser.HTMLParser):
    """What a browser would make of a page: its text, its plots, its scripts and its tags."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.plots, self.texts, self.links, self.scripts = [], {}, [], [], []
        self._inside = ""
        self._title = ""
        self.feed(text)
        self.text = " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.tags.append(tag)
        self._inside = found.get("class", "") if tag == "span" else ""
        if tag == "script" and found.get("type") != "application/json":
            self._inside = "program"
        elif tag in ("script", "style"):
            self._inside = "hidden"
        self.links += [found[name] for name in ("src", "href") if name in found]

    def handle_data(self, data):
        if self._inside == "program":
            self.scripts.append(data)
        elif self._inside != "hidden":
            self.texts.append(data)
        if self._inside == "plot-title":
            self._title = data
        elif self._inside == "plot-seen":
            self.plots.setdefault(self._title, data)  # the first of this title
        self._inside = ""


def surveyed(path):
    with rpud_sim.bag.open(path) as bag:
        return survey(bag)


@pytest.fixture(scope="module")
def drilled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "scenario.yaml").write_text(SCENARIO)
    scenario = read_scenario(folder / "scenario.yaml")
    write_offline_bag(folder / "bag", preset("drilling"), DURATION, scenario=scenario)
    return folder / "bag"


@pytest.fixture(scope="module")
def seen(drilled):
    return surveyed(drilled)


@pytest.fixture(scope="module")
def page(drilled):
    out = drilled.parent / "new" / "report.html"
    out.parent.mkdir()
    write_report(drilled, out)
    assert [path.name for path in out.parent.iterdir()] == ["report.html"]
    return Page(out.read_text(encoding="utf-8"))


def test_the_page_needs_nothing_beside_it(page):
    assert not {"link", "iframe", "object", "img"} & set(page.tags)
    assert page.links == ["#main", *(f"#{section}" for section in SECTIONS)]
    assert page.scripts == [bokeh_script(), plots_script()]


def test_every_section_has_its_plots_and_each_says_what_is_seen(page):
    expected = {
        "peak contact force [kN]",
        "impact rate [1/s]",
        "power of the arriving free mass [W]",
        "reacting force [N]",
        "weight on bit [N]",
        "distribution of the peak contact force [impacts]",
        "contact force: power spectral density [N²/Hz]",
        "positions, the rock is below [mm]",
        "drill tool displacement [µm]",
        "faults",
    }
    assert expected <= page.plots.keys()
    assert page.tags.count("figcaption") > len(expected)
    for name, seen in page.plots.items():
        assert seen.endswith("."), name
    assert page.plots["faults"] == (
        "2 faults: bias wrench from 0.25 s to 0.75 s; lost_preload from 0.9 s on."
    )
    assert page.plots["peak contact force [kN]"].startswith("Peak contact force over 1 s: between")
    assert "svg" in page.tags  # the flow of power


def test_segments_lie_between_commands_and_faults(seen, page):
    found = seen.periods["/rpud"].all
    assert [round(period.begin, 6) for period in found] == [0.0, 0.25, 0.75, 0.9]
    assert [period.faults for period in found] == ["", "bias wrench", "", "lost_preload"]
    assert {period.commands for period in found} == {"weight on bit 10 N"}
    topic = seen.topics["/rpud/contact_force"]
    assert sum(period.impacts for period in found) == topic.find("peak_force").count
    assert sum(period.energy for period in found) == pytest.approx(topic.find("energy").total)
    assert found[-1].end == pytest.approx(DURATION, abs=0.01)
    assert "0.250000 0.750000 weight on bit 10 N bias wrench" in page.text


def test_a_command_begins_a_segment_and_is_marked(tmp_path):
    seen = surveyed(write_commanded_bag(tmp_path / "bag", DURATION, {0.5: WeightOnBit(40.0)}))
    found = seen.periods["/rpud"].all
    assert [period.commands for period in found] == ["weight on bit 10 N", "weight on bit 40 N"]
    assert found[1].begin == pytest.approx(0.5)
    assert found[1].reacting_force.mean > 2.0 * found[0].reacting_force.mean
    assert [(mark.kind, mark.time, mark.text) for mark in run_marks(seen)] == [
        (COMMAND, pytest.approx(0.5), "weight on bit 40 N")
    ]
    plots = Page(render(seen)).plots
    assert plots["weight on bit [N]"] == (
        "Weight on bit: between 10 and 40 N; 10 N at first, 40 N at last."
    )
    assert "with the command weight on bit 40 N" in plots["reacting force [N]"]


def test_the_page_of_an_hour_is_small(drilled):
    """However long the run, a series has at most so many parts: here each has all of them."""
    seen = surveyed(drilled)
    parts = 0.5 + np.arange(1000.0)
    for topic in seen.topics.values():
        for series in topic.series:
            if not series.values.count:
                continue
            series.values.add(np.array([1.0, 2.0]))
            series.envelope = Envelope(1000.0)
            series.changing.add(np.arange(2000.0), np.arange(2000.0))
            for value in np.random.default_rng(1).random((3, len(parts))):
                series.envelope.add(parts, value)
    text = render(seen)
    assert text.count('class="plot-data"') > 60
    assert len(text.encode()) < 6_000_000
    print(len(text.encode()))


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


def test_parameters_and_journal_are_told(page):
    assert "vibration_amplitude 3.5e-05" in page.text
    assert "inject" not in page.text
    assert '1.000000 end {"time": 1000000000}' in page.text


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


def test_a_bag_of_any_other_node_has_a_report_that_says_what_is_not_there(tmp_path):
    page = Page(render(surveyed(write_everything(tmp_path / "bag"))))
    for reason in (
        "No impacts: record the topic contact_force.",
        "No spectra: record the topic waveform",
        "No account of the drill's own timing: record the topic status.",
        "Nothing is known of faults: record the topic faults.",
        "None are told: neither a manifest nor the topic journal is in the bag.",
        "The bag has no manifest",
    ):
        assert reason in page.text
    assert "part.turn [rad]" in page.plots or "part.turn rad" in page.text
    assert "part.turn rad 0" in page.text


def test_an_empty_bag_has_a_report(tmp_path):
    page = Page(render(surveyed(write_bag(tmp_path / "bag", 0))))
    assert "No topic has numbers to show." in page.text
    with BagWriter(tmp_path / "none"):
        pass
    assert "messages 0 on 0 topics" in Page(render(surveyed(tmp_path / "none"))).text


def test_topics_of_the_drill_without_messages_are_no_failure(drilled, tmp_path):
    with rpud_sim.bag.open(drilled) as source, BagWriter(tmp_path / "bag") as bag:
        for summary in source.topics:
            bag.add_topic(summary.topic, summary.definition)
        first = next(source.messages(["/rpud/contact_force"]))
        bag.write(first.topic, first.data, first.log_time, first.publish_time)
    page = Page(render(surveyed(tmp_path / "bag")))
    assert "drill_tool_impacts 1" in page.text
    assert "There were none." in page.text
    assert "Too few samples for a spectrum." in page.text


def test_hostile_names_and_values_are_text(tmp_path):
    evil = "/<script>alert(1)</script>$\\frac{\"'&amp;"
    definition = "float64 value # [$\\x_{<b>]\n"
    kind = "rpud_msgs/msg/JournalEntry"
    journal = "string kind\nstring content\nstd_msgs/Header header\n"
    with BagWriter(tmp_path / "<i>bag") as bag:
        bag.add_topic(Topic(evil, "pkg/msg/Evil"), definition)
        bag.add_topic(Topic("/journal", kind), journal)  # without a definition of its header
        for number, value in enumerate((1e308, -1e149, 1e149, np.nan, np.inf, 5e-324, 1.0)):
            data = serialized("pkg/msg/Evil", definition, {"value": value})
            bag.write(evil, data, START + number * SECOND, START)
        bag.add_record(MANIFEST, Manifest(node="<b>", parameters={"<u>": "</td>"}).to_record())
    page = Page(render(surveyed(tmp_path / "<i>bag")))
    plain = Page(render(surveyed(write_everything(tmp_path / "plain"))))
    assert set(page.tags) <= {*plain.tags, "details", "summary"}  # nothing of a bag became a tag
    assert page.scripts == plain.scripts
    assert "</td>" in page.text
    assert f"Statistics of {evil}" in page.text
    assert any("$\\x_{<b>" in title for title in page.plots)
    assert "Not in this report: /journal" in page.text


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


def test_what_cannot_be_read_is_named(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.add_topic(Topic("/untold", "pkg/msg/Untold"))
    seen = surveyed(tmp_path / "bag")
    assert seen.left_out == {"/untold": "the bag does not hold the definition of its type"}
    with pytest.raises(BagError, match="there is no bag"):
        write_report(tmp_path / "none", tmp_path / "out.html")


def test_nothing_is_overwritten(tmp_path):
    write_bag(tmp_path / "bag")
    (tmp_path / "out.html").write_text("mine")
    with pytest.raises(ReportError, match=r"out.html exists already; nothing is overwritten"):
        write_report(tmp_path / "bag", tmp_path / "out.html")
    assert (tmp_path / "out.html").read_text() == "mine"


def test_nothing_is_written_through_names_that_are_there(tmp_path):
    write_bag(tmp_path / "bag")
    mine = tmp_path / "mine"
    mine.write_text("mine")
    (tmp_path / "out.html.part").symlink_to(mine)
    (tmp_path / "other.html").symlink_to(tmp_path / "nowhere")
    write_report(tmp_path / "bag", tmp_path / "out.html")
    with pytest.raises(ReportError, match=r"other.html exists already; nothing is overwritten"):
        write_report(tmp_path / "bag", tmp_path / "other.html")
    assert mine.read_text() == "mine"
    assert (tmp_path / "out.html.part").is_symlink()
    assert not (tmp_path / "nowhere").exists()


def test_no_folder_is_made_for_it(tmp_path):
    write_bag(tmp_path / "bag")
    out = tmp_path / "no" / "where" / "out.html"
    with pytest.raises(ReportError, match=f"^cannot write {out}: there is no folder {out.parent}$"):
        write_report(tmp_path / "bag", out)
    assert not (tmp_path / "no").exists()


REPORT = "import sys; from rpud_sim.inspection.report.bag_report import *\n"


def test_a_disk_that_is_full_is_one_error_and_leaves_nothing_behind(tmp_path):
    write_bag(tmp_path / "bag")
    script = REPORT + "try: write_report(*sys.argv[1:])\nexcept ReportError as e: print(e)"
    done = subprocess.run(
        [sys.executable, "-c", script, tmp_path / "bag", tmp_path / "out.html"],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)),
        capture_output=True,
        text=True,
    )
    assert done.stdout == f"cannot write {tmp_path / 'out.html'}: File too large\n", done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_memory_does_not_grow_with_the_bag(tmp_path):
    script = REPORT + (
        "write_report(*sys.argv[1:])\n"
        "print(int(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0]))"
    )

    def peak(size):
        long_waveform(tmp_path / str(size), size)
        command = [sys.executable, "-c", script, tmp_path / str(size), tmp_path / f"{size}.html"]
        return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

    small, large = peak(30_000_000), peak(90_000_000)
    assert large < small + 48_000  # KiB; the bag has 60 MB more
    assert large < 500_000
