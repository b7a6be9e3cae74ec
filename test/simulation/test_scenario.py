"""Scenarios of faults: the same seed draws the same, and a mistake is one line that finds it."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from plain_values import contents
from support import refusal

from rpud_sim.simulation.changes import Change, Inject, injected
from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, check_supported
from rpud_sim.simulation.scenario_file import parse_scenario, read_scenario
from rpud_sim.simulation.topics import CHANNELS

CONFIG = Path(__file__).parents[2] / "config"
SECOND = 1_000_000_000


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "faults.yaml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize(
    ("name", "count", "values"),
    [
        ("faults.yaml", 6, {"actuator_model": "resonance", "rock_model": "specific_energy"}),
        (
            "faults_on_an_arm.yaml",
            8,
            {"strata": "sandstone", "rotation_model": "friction_drive", "feed_model": "arm"},
        ),
    ],
)
def test_the_examples_are_possible(name, count, values):
    scenario = read_scenario(CONFIG / name)
    assert len(scenario) == count
    for _, fault in injected(scenario):
        check_supported(fault, to_configuration(values))


def test_times_are_exact_and_faults_are_in_their_order(file):
    path = file(
        "faults:\n"
        "  - {kind: free_mass_jammed, onset: 2.000000001, duration: 1.5}\n"
        "  - {kind: free_mass_jammed, onset: 3.500000001}\n"  # when the one before ends
        "  - {kind: noise, channel: wrench, magnitude: 1e-3, onset: 1}\n"
        "  - {kind: off, channel: drill_tool, onset: 0, magnitude: .nan}\n"
        "  - {kind: off, channel: wrench, onset: 0, magnitude: 0}\n"
    )
    assert read_scenario(path) == (
        Change(0, Inject(Fault("off", "drill_tool"))),
        Change(0, Inject(Fault("off", "wrench"))),
        Change(SECOND, Inject(Fault("noise", "wrench", 1e-3))),
        Change(2_000_000_001, Inject(Fault("free_mass_jammed"), 3 * SECOND // 2)),
        Change(3_500_000_001, Inject(Fault("free_mass_jammed"))),
    )


DRAWN = (
    "{kind: lost_preload, magnitude: {uniform: [0.2, 0.4]}, "
    "onset: {uniform: [1, 3]}, duration: {uniform: [0.5, 1.5]}}"
)


def test_the_same_seed_draws_the_same_within_the_bounds(file):
    path = file(f"seed: 3\nfaults: [{DRAWN}]\n")
    first = read_scenario(path)
    assert first == read_scenario(path) == read_scenario(path, seed=3)
    other = read_scenario(path, seed=4)
    assert other != first
    for (one,) in (first, other):
        assert SECOND <= one.time <= 3 * SECOND
        assert 0.5 * SECOND <= one.action.duration <= 1.5 * SECOND
        assert 0.2 <= one.action.fault.magnitude <= 0.4


def test_what_one_entry_draws_does_not_depend_on_the_others(file):
    alone = read_scenario(file(f"faults: [{DRAWN}]"))
    beside = read_scenario(
        file(f"faults: [{DRAWN}, {{kind: choking, onset: {{uniform: [0, 9]}}}}]")
    )
    assert alone[0] in beside
    fixed = read_scenario(file("faults: [" + DRAWN.replace("{uniform: [0.2, 0.4]}", "0.3") + "]"))
    assert fixed[0].time == alone[0].time


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", ":1: the file is not a mapping"),
        ("{}", ":1: faults is missing"),
        ("faults: [{kind: off, onset: 1}]", ":1: off needs a channel: one of "),
        (
            "faults: [{kind: choking, onset: 2}, {kind: choking, onset: 1, duration: 1.5}]",
            ":1: choking begins while entry 2 is active",
        ),
    ],
)
def test_a_mistake_in_the_file_is_one_line_that_finds_it(file, text, complaint):
    path = file(text)
    assert refusal(read_scenario, path).startswith(f"{path}{complaint}")


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        ("until", 3, "'until' is not a key here; valid ones are kind,"),
        ("onset", {"normal": [1, 2]}, "onset: 'normal' is not a key here; did you mean uniform?"),
        ("onset", {"uniform": [3, 1]}, "onset = {'uniform': [3, 1]} has its least above its most"),
    ],
)
def test_a_mistake_in_an_entry_is_one_line_that_finds_it(key, value, complaint):
    content = {"faults": [{"kind": "choking", "onset": 1, key: value}]}
    found = refusal(parse_scenario, content, "f")
    assert found.startswith("f: faults[0]")
    assert complaint in found


_, VALUES = contents(
    ("kind", "channel", "magnitude", "onset", "duration", "uniform"),
    (*KINDS, *CHANNELS, "seed", "faults", 1.0, 2, 10**400),
)
NUMBERS = st.one_of(
    st.floats(0, 10),
    st.fixed_dictionaries({"uniform": st.lists(st.floats(0, 10), min_size=1, max_size=3)}),
    VALUES,
)
ENTRIES = st.fixed_dictionaries(
    {"kind": st.sampled_from([*KINDS]), "onset": NUMBERS},
    optional={
        "channel": st.sampled_from([*CHANNELS]) | VALUES,
        "magnitude": NUMBERS,
        "duration": NUMBERS,
        "other": VALUES,
    },
)
CONTENTS = VALUES | st.fixed_dictionaries(
    {"faults": st.lists(ENTRIES, max_size=4)}, optional={"seed": st.integers(0) | VALUES}
)


@given(content=CONTENTS)
def test_any_content_is_a_usable_scenario_or_refused_in_one_line(content):
    if found := refusal(parse_scenario, content, "file.yaml"):
        assert found.startswith("file.yaml")
        assert len(found) < 500
        return
    scenario = parse_scenario(content, "file.yaml")
    assert parse_scenario(content, "file.yaml") == scenario
    ends: dict[tuple[str, str], float] = {}
    onset = 0
    for change, fault in injected(scenario):
        key, duration = (fault.kind, fault.channel), change.action.duration
        assert change.time >= max(onset, ends.get(key, 0))
        assert duration >= 0
        onset, ends[key] = change.time, change.time + duration if duration else math.inf
