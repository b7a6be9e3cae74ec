"""The page shows what is in the bag, needs no other file, and shows every name as text."""

import resource
import subprocess
import sys

import numpy as np
import pytest
from inspection.report.read_page import Page, surveyed
from long_waveform import long_waveform
from sample_bags import (
    SECOND,
    START,
    STRING_DEFINITION,
    TALK,
    serialized,
    write_bag,
    write_everything,
)

import rpud_sim.bag
from rpud_sim.bag import BagError, BagWriter, Topic
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST
from rpud_sim.bag.manifest import Manifest
from rpud_sim.inspection.report.bag_report import ReportError, render, write_report
from rpud_sim.inspection.report.running_statistics import Envelope
from rpud_sim.pages.embedding import bokeh_script, plots_script

SECTIONS = (
    "run", "impacts", "segments", "force", "energy", "spectra", "series", "timing", "faults",
)  # fmt: skip


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


@pytest.mark.extended
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


def test_parameters_and_journal_are_shown(page):
    assert "vibration_amplitude 2e-05" in page.text
    assert "inject" not in page.text
    assert '1.000000 end {"time": 1000000000}' in page.text


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


@pytest.mark.extended
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
