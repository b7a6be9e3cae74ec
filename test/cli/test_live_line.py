"""The live line of `rpud run` shows what the drill does, and fits the terminal."""

import contextlib
import dataclasses
import io
import os
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.cli.live_line import LiveLine, live_text, logging_above, summary_text
from rpud_sim.foundation.shown_quantities import QUANTITIES
from rpud_sim.ros.drill.health import Report
from rpud_sim.simulation.changes import Clear, Inject
from rpud_sim.simulation.commands import Feed, WeightOnBit
from rpud_sim.simulation.configuration import Settings, to_configuration
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import CommandCounts
from rpud_sim.simulation.metrics import Metrics
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run

MILLISECOND = 1_000_000


TIMING = {
    "real_time_factor": 1.0,
    "lateness_max": 0.0013,
    "deadlines_missed": 0,
    "messages_dropped": 0,
}


class Drill:
    """A run and the report of what it did since the report before."""

    def __init__(self, **parameters):
        self.statistics = Metrics()
        beginning = Beginning(Settings(to_configuration(parameters)))
        self.run = Run(Plan(beginning), on_block=self._add)
        self.simulation = self.run.simulation

    def _add(self, block):
        self.statistics.add(block)

    def report(
        self, until=100 * MILLISECOND, state="running", requests=0, refusal="", timing=(), **counts
    ):
        self.statistics = Metrics()
        list(self.run.advance_to(until))
        return Report(
            time=self.run.time,
            status=self.run.status(state, CommandCounts(**counts)).fields,
            timing={**TIMING, **dict(timing)},
            figures=self.statistics.values(),
            process=self.simulation.process,
            faults=self.simulation.faults.active,
            requests_refused=requests,
            last_refusal=refusal,
        )


@pytest.fixture(scope="module")
def healthy():
    return Drill(rock_model="specific_energy").report()


def test_it_shows_state_weight_on_bit_impacts_forces_depth_and_timing(healthy):
    text = live_text(healthy)
    assert text.startswith("    0.1 s  running  8 N on bit  ")
    assert f"{healthy.figures['drill_tool_impact_rate']:.0f} impacts/s" in text
    force = QUANTITIES["peak_force"].text(healthy.figures["contact_force_mean"])
    assert f"peak force {force} mean" in text
    assert re.search(r"peak force \d\.\d+ kN mean \d\.\d+ kN max", text)
    load = QUANTITIES["reacting_force"].text(healthy.figures["reacting_force_mean"])
    assert f"reacting force {load}" in text
    assert f"depth {QUANTITIES['depth'].text(healthy.status['depth'])}" in text
    assert text.endswith("late 1.3 ms  x1.000")
    for word in ("fault", "refused", "feed", "rad/s", "torque", "sandstone"):
        assert word not in text
    assert "depth" not in live_text(Drill(rock_model="none").report())


def test_a_jammed_drill_is_jammed_and_one_without_drive_has_no_impacts():
    drill = Drill()
    drill.report()
    drill.run.apply(Inject(Fault("free_mass_jammed")))
    drill.report(200 * MILLISECOND)  # the free mass strikes once more, and stays
    text = live_text(drill.report(300 * MILLISECOND))
    assert "  jammed  " in text
    assert "faults: free_mass_jammed" in text
    assert "  -" not in text
    assert "peak force" not in text
    off = live_text(Drill(drive_enabled=False, regime="free").report())
    assert "drive off  no impacts" in off
    assert "jammed" not in off


def test_one_of_something_is_named_in_the_singular():
    late = Drill(rock_model="specific_energy").report(requests=1)
    one = late._replace(status={**late.status, "impacts": 1, "commands_accepted": 1})
    text = summary_text(one.figures, one)
    assert "\n1 impact, 0 deadlines missed, 1 command accepted, " in text
    assert "\n1 request rejected" in text


def test_in_80_columns_all_that_matters_is_there():
    drill = Drill(rock_model="specific_energy")
    for fault in (Fault("hard_rock"), Fault("lost_preload"), Fault("off", "wrench")):
        drill.run.apply(Inject(fault))
    drill.run.apply(WeightOnBit(123.4))
    refused = {"commands_rejected": 122, "requests": 1}
    late = drill.report(**refused, timing={"messages_dropped": 4})
    long = live_text(late._replace(status={**late.status, "commands_lost": True}))
    for word in ("faults: hard_rock, lost_preload, off", "4 messages dropped", "commands lost"):
        assert word in long
    text = live_text(drill.report(200 * MILLISECOND, **refused), 80)
    assert len(text) < 80
    for word in ("123 N", "/s", "mm", "hard_rock +2", "123 rejected"):
        assert word in text


ARM = {"feed_model": "arm", "rotation_model": "friction_drive", "strata": "sandstone"}


def test_models_around_the_percussion_are_told_where_they_are_on():
    drill = Drill(**ARM, initial_feed=0.006)
    drill.run.apply(Feed("rate", 1e-3))
    report = drill.report()
    text = live_text(report)
    assert "  feed 6.1 mm, 1 mm/s  " in text
    rotation = report.process.rotation
    rate, torque = QUANTITIES["rotation_rate"], QUANTITIES["torque"]
    assert f"  {rate.text(rotation.rate)}, torque {torque.text(rotation.torque)}  " in text
    assert text.index("depth ") < text.index("  in sandstone  ")
    stalled = dataclasses.replace(
        report.process, rotation=dataclasses.replace(rotation, stalled=True)
    )
    assert "  stalled, torque" in live_text(report._replace(process=stalled))
    for part in ("N", "/s", "in sandstone"):
        assert part in live_text(report, 80)


@given(
    width=st.integers(1, 300),
    refused=st.integers(0, 10**9),
    dropped=st.integers(0, 10**9),
    late=st.floats(0.0, 1e6),
    lost=st.booleans(),
)
def test_it_never_reaches_the_last_column(healthy, width, refused, dropped, late, lost):
    status = {**healthy.status, "commands_rejected": refused, "commands_lost": lost}
    timing = {**TIMING, "messages_dropped": dropped, "lateness_max": late}
    report = healthy._replace(status=status, timing=timing)
    text = live_text(report, width)
    assert len(text) < width
    assert text.isprintable()
    assert len(live_text(report)) >= len(text)


class Terminal(io.StringIO):
    """Standard error that is a terminal."""

    def isatty(self):
        return True


def test_a_terminal_sees_each_report_in_the_same_line_and_also_a_pause(monkeypatch):
    drill = Drill()
    reports = [drill.report(), drill.report(state="paused")]
    monkeypatch.setattr("sys.stderr", stream := Terminal())
    with LiveLine(True) as line:
        for report in (None, reports[0], reports[0], reports[1]):
            line.show(report)
    printed = stream.getvalue()
    assert printed.endswith("\n")
    assert printed.count("\n") == 1
    lines = printed.split("\r\x1b[K")[1:]
    assert ["running" in lines[0], "paused" in lines[1], len(lines)] == [True, True, 2]
    assert all(len(text.rstrip("\n")) < 80 for text in lines)


def test_elsewhere_it_is_a_line_for_each_second_in_which_the_drill_moves(monkeypatch):
    drill = Drill()
    first = drill.report()
    on_change = first._replace(requests_refused=1)  # between two seconds
    still = drill.report(state="paused")
    second = drill.report(200 * MILLISECOND)
    monkeypatch.setattr("sys.stderr", stream := io.StringIO())
    with LiveLine(True) as line:
        for report in (first, on_change, still, second):
            line.show(report)
    assert [text[:9] for text in stream.getvalue().splitlines()] == ["    0.1 s", "    0.2 s"]
    assert "\x1b" not in stream.getvalue()


def test_the_summary_has_faults_depth_and_the_last_refusal(healthy):
    drill = Drill(rock_model="specific_energy")
    [number] = drill.run.apply(Inject(Fault("hard_rock")))
    report = drill.report(
        commands_rejected=1, requests=2, refusal="there is no fault 9\x1b to clear"
    )
    drill.run.apply(Clear(number))
    drill.run.apply(Inject(Fault("off", "wrench")))
    text = summary_text(report.figures, report, drill.simulation.faults.records)
    assert text.splitlines()[0].startswith("drilled 0.10 s: ")
    assert "0 commands accepted, 1 rejected, 0 messages dropped" in text
    assert "2 requests rejected" in text
    assert r"last rejection: there is no fault 9\x1b to clear" in text
    assert f"depth {QUANTITIES['depth'].text(report.status['depth'])}" in text
    assert "fault 1: hard_rock from 0.000 s to 0.100 s" in text
    assert text.endswith("fault 2: off on wrench from 0.100 s on")
    assert summary_text(healthy.figures, None).count("\n") == 0


def test_log_lines_erase_the_live_line_and_later_processes_do_not_inherit_it(monkeypatch):
    variable = "RCUTILS_CONSOLE_OUTPUT_FORMAT"
    seen = []

    @contextlib.contextmanager
    def opening():
        seen.append(os.environ.get(variable))
        yield

    monkeypatch.setattr("sys.stderr", Terminal())
    monkeypatch.delenv(variable, raising=False)
    with logging_above(True, opening()):
        assert variable not in os.environ
    monkeypatch.setenv(variable, "{message}")
    for live in (True, False):
        with logging_above(live, opening()):
            assert os.environ[variable] == "{message}"
    assert seen[0].startswith(r"\r\x1b[K[{severity}]")
    assert seen[1:] == [r"\r\x1b[K{message}", "{message}"]
