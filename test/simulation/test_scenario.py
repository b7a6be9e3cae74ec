"""Scenarios of faults: the same seed draws the same, and a mistake is one line that finds it."""

from pathlib import Path

import pytest
from hostile import contents
from hypothesis import given
from hypothesis import strategies as st
from support import refusal

from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, check_supported
from rpud_sim.simulation.plans import Scenario, ScheduledFault
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
def test_the_examples_can_be_honoured(name, count, values):
    scenario = read_scenario(CONFIG / name)
    assert len(scenario.faults) == count
    for scheduled in scenario.faults:
        check_supported(scheduled.fault, to_configuration(values))


def test_times_are_exact_and_faults_are_in_their_order(file):
    path = file(
        "faults:\n"
        "  - {kind: free_mass_jammed, onset: 2.000000001, duration: 1.5}\n"
        "  - {kind: free_mass_jammed, onset: 3.500000001}\n"  # when the one before ends
        "  - {kind: noise, channel: wrench, magnitude: 1e-3, onset: 1}\n"
        "  - {kind: off, channel: drill_tool, onset: 0, magnitude: .nan}\n"
        "  - {kind: off, channel: wrench, onset: 0, magnitude: 0}\n"
    )
    assert read_scenario(path) == Scenario(
        0,
        (
            ScheduledFault(0, None, Fault("off", "drill_tool")),
            ScheduledFault(0, None, Fault("off", "wrench")),
            ScheduledFault(SECOND, None, Fault("noise", "wrench", 1e-3)),
            ScheduledFault(2_000_000_001, 3_500_000_001, Fault("free_mass_jammed")),
            ScheduledFault(3_500_000_001, None, Fault("free_mass_jammed")),
        ),
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
    assert other.seed == 4
    assert other.faults != first.faults
    for (one,) in (first.faults, other.faults):
        assert SECOND <= one.onset <= 3 * SECOND
        assert 0.5 * SECOND <= one.duration <= 1.5 * SECOND
        assert 0.2 <= one.fault.magnitude <= 0.4


def test_what_one_entry_draws_does_not_depend_on_the_others(file):
    alone = read_scenario(file(f"faults: [{DRAWN}]"))
    beside = read_scenario(
        file(f"faults: [{DRAWN}, {{kind: choking, onset: {{uniform: [0, 9]}}}}]")
    )
    assert alone.faults[0] in beside.faults
    fixed = read_scenario(file("faults: [" + DRAWN.replace("{uniform: [0.2, 0.4]}", "0.3") + "]"))
    assert fixed.faults[0].onset == alone.faults[0].onset


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", ":1: the file is not a mapping"),
        ("faults: [", " is not YAML: while parsing"),
        ("{}", ":1: faults is missing"),
        ("fault: []", ":1: 'fault' is not a key here; did you mean faults?"),
        ("{seed: -1, faults: []}", ":1: seed = -1 is outside its range [0, "),
        ("faults: [3]", ":1: faults[0] = 3 is not a mapping"),
        ("faults: [{kind: choking}]", ":1: onset is missing"),
        ("faults: [{kind: off, onset: 1}]", ":1: channel of off = '' is not one of "),
        (
            "faults: [{kind: choking, onset: 2}, {kind: choking, onset: 1, duration: 1.5}]",
            ":1: choking begins while that of entry 2 lasts",
        ),
    ],
)
def test_a_mistake_in_the_file_is_one_line_that_finds_it(file, text, complaint):
    path = file(text)
    assert refusal(read_scenario, path).startswith(f"{path}{complaint}")


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        ("until", 3, "'until' is not a key here; known are kind,"),
        ("onset", -1, "onset = -1 s is outside its range [0, 1e+06] s"),
        ("duration", 0, "duration = 0 s is outside its range [1e-09, 1e+06] s"),
        (
            "magnitude",
            {"uniform": [float("nan"), 1]},
            "magnitude.uniform[0] = nan is outside",
        ),
        ("onset", {"normal": [1, 2]}, "onset: 'normal' is not a key here; did you mean uniform?"),
        ("onset", {"uniform": [1]}, "onset.uniform = [1] has 1 entries, not 2"),
        ("onset", {"uniform": [3, 1]}, "onset = {'uniform': [3, 1]} has its least above its most"),
    ],
)
def test_a_mistake_in_an_entry_is_one_line_that_finds_it(key, value, complaint):
    content = {"faults": [{"kind": "choking", "onset": 1, key: value}]}
    found = refusal(parse_scenario, content, "f")
    assert found.startswith("f: faults[0]")
    assert complaint in found


@pytest.mark.parametrize("seed", [-1, 1.5, True, "7", 2**63])
def test_a_seed_that_is_none_is_refused(seed):
    assert ": seed = " in refusal(read_scenario, CONFIG / "faults.yaml", seed)


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
    ends: dict[tuple[str, str], int | None] = {}
    onset = 0
    for scheduled in scenario.faults:
        key = (scheduled.fault.kind, scheduled.fault.channel)
        end = ends.get(key, 0)
        assert scheduled.onset >= onset
        assert end is not None
        assert scheduled.onset >= end
        assert scheduled.clear is None or scheduled.clear > scheduled.onset
        onset, ends[key] = scheduled.onset, scheduled.clear
