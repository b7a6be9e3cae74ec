"""Faults change the drill at their exact instants, and their ledger is the ground truth."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from drill_configurations import FULL, RESONANT, SANDSTONE
from fault_signatures import ON_AN_ARM_ALONE as SLOW
from hypothesis import given, settings
from hypothesis import strategies as st
from silent_drill import SilentDrill
from support import examples

from rpud_sim.drilling.mount import MountParameters
from rpud_sim.drilling.rotor import RotationParameters
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.changes import Change, Inject, in_order
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import MOST_CLEARED, Fault, FaultLedger, FaultRecord

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
END = 80 * MILLISECOND
HOT = dataclasses.replace(RESONANT, heating=True, heat_capacity=0.01)
ON_AN_ARM = dataclasses.replace(
    FULL,
    rotation=RotationParameters(rotation_model="friction_drive"),
    mount=MountParameters(feed_model="arm", initial_feed=0.005),
)
PHYSICAL = [name for name, kind in KINDS.items() if kind.physical and name not in SLOW]


def scheduled(kind, onset, clear=None, magnitude=math.nan, channel=""):
    return Change(onset, Inject(Fault(kind, channel, magnitude), clear - onset if clear else 0))


def spans(simulation):
    return [(record.fault.kind, record.onset, record.clear) for record in simulation.faults.records]


@st.composite
def scenarios(draw, kinds):
    faults = []
    for kind in draw(st.lists(st.sampled_from(kinds), unique=True, max_size=5)):
        instants = draw(st.lists(st.integers(0, END), min_size=1, max_size=4, unique=True))
        for onset, clear in list(pairwise([*sorted(instants), None]))[::2]:
            faults.append(scheduled(kind, onset, clear))
    return in_order(faults)


commands = st.one_of(
    st.builds(WeightOnBit, st.floats(0.0, 60.0)),
    st.builds(Drive, st.just(True), st.floats(50.0, 200.0), st.floats(15e3, 17e3)),
    st.just(Drive(False, 0.0, 0.0)),
)
moments = st.integers(0, END)


def run(configuration, faults, given_commands, stops):
    """Give all that happened until the end, where a caller stops now and then."""
    simulation = SilentDrill(configuration, faults=faults)
    segments, impacts = [], []
    for time in sorted({*stops, *given_commands, END}):
        block = simulation.advance_to(time)
        segments += block.segments.tolist()
        impacts += block.impacts.tolist()
        if time in given_commands:
            simulation.apply(given_commands[time])
    states = (simulation.depth, simulation.penetration_rate, simulation.process)
    return (
        segments + block.open_segment.tolist(),
        impacts,
        spans(simulation),
        repr((states, simulation.actuator)),
        simulation.impact_count,
    )


drills = st.builds(
    Configuration,
    st.sampled_from([preset("free"), preset("drilling")]),
    st.sampled_from([RESONANT, HOT]),
    st.just(SANDSTONE),
)
alone = st.tuples(drills, scenarios(PHYSICAL), st.dictionaries(moments, commands, max_size=3))
on_an_arm = st.tuples(st.just(ON_AN_ARM), scenarios(SLOW), st.just({0: Feed("rate", 1e-3)}))


@settings(max_examples=examples(25))
@given(alone | on_an_arm, st.lists(moments, max_size=15))
def test_where_a_caller_stops_changes_no_bit(drilled, stops):
    assert run(*drilled, []) == run(*drilled, stops)


@pytest.mark.parametrize("kind", [kind for kind in SLOW if kind not in ("feed_stall", "arm_slip")])
def test_a_fault_of_rotation_and_hole_leaves_the_bits_of_the_percussion(kind):
    configuration = dataclasses.replace(ON_AN_ARM, mount=MountParameters())
    plain, faulty = SilentDrill(configuration), SilentDrill(configuration)
    faulty.inject(Fault(kind))
    for end in (50 * MILLISECOND, 200 * MILLISECOND):
        one, other = plain.advance_to(end), faulty.advance_to(end)
    assert one.open_segment.tolist() == other.open_segment.tolist()
    assert (one.impacts == other.impacts).all()
    assert plain.process != faulty.process


def test_scheduled_faults_come_and_go_at_their_instants():
    times = [
        ("lost_preload", 0, 123_456_789),
        ("restitution_loss", 123_456_789, None),
        ("load_spring_binding", 400_000_001, 400_000_002),
    ]
    simulation = SilentDrill(Parameters(), faults=[scheduled(*each) for each in times])
    segments = simulation.advance_to(SECOND).segments
    assert spans(simulation) == times
    begun = np.rint(segments["start_seconds"] * 1e9 + segments["start_fraction"] * SECOND)
    lost = begun < 123_456_789
    assert (segments["weight_on_bit"] == np.where(lost, 4.0, 8.0))[1:].all()  # the first is empty
    stiff = segments["load_spring_rate"] == 10_000.0
    assert set(begun[stiff]) == {400_000_001}
    assert segments["duration"][stiff].sum() == pytest.approx(1e-9, rel=1e-3)


def test_a_scheduled_fault_that_cannot_begin_is_refused_and_reported():
    free = preset("free")
    planned = [
        scheduled("free_mass_jammed", SECOND),
        scheduled("drill_tool_binding", SECOND),
        scheduled("lost_preload", 2 * SECOND),
    ]
    rejected = []
    simulation = SilentDrill(
        Configuration(free),
        faults=planned,
        rejected=lambda change, error: rejected.append(str(error)),
    )
    assert simulation.inject(Fault("free_mass_jammed")) == 1
    simulation.configure(Configuration(free.replace(regime="drilling")))
    simulation.advance_to(3 * SECOND)
    there, impossible = rejected
    assert there == "free_mass_jammed is already there as fault 1"
    assert impossible.startswith("drill_tool_binding is not possible:")
    assert spans(simulation) == [("free_mass_jammed", 0, None), ("lost_preload", 2 * SECOND, None)]


def test_a_duration_ends_the_fault_and_a_clear_before_ends_it_once():
    simulation = SilentDrill(Parameters())
    simulation.advance_to(10)
    first = simulation.inject(Fault("lost_preload"), 500)
    second = simulation.inject(Fault("noise", "wrench"), 700)
    simulation.advance_to(100)
    simulation.clear(second)
    # One of the same kind may begin, and the first one's end is not its own.
    third = simulation.inject(Fault("noise", "wrench"))
    simulation.advance_to(SECOND)
    ends = {record.number: record.clear for record in simulation.faults.records}
    assert ends == {first: 510, second: 100, third: None}


def test_all_faults_clear_at_once_and_the_drill_is_as_it_was():
    simulation = SilentDrill(FULL)
    for kind in PHYSICAL:
        simulation.inject(Fault(kind))
    simulation.advance_to(SECOND // 10)
    simulation.clear()
    assert simulation.faults.active == ()
    assert {record.clear for record in simulation.faults.records} == {SECOND // 10}
    constants = simulation.advance_to(SECOND // 5).segments[-1]
    healthy = SilentDrill(FULL).advance_to(SECOND // 5).segments[-1]
    for name in ("load_spring_rate", "load_spring_damping", "drill_tool_spring_rate"):
        assert constants[name] == healthy[name], name
    assert constants["weight_on_bit"] == 8.0
    assert simulation.actuator.resonance_frequency == 16000.0


@pytest.mark.parametrize(
    ("fault", "factor"),
    [
        (Fault("hard_rock", magnitude=4.0), 0.25),
        (Fault("choking", magnitude=0.75), 0.25),
        (Fault("drill_tool_binding", magnitude=2.0), 0.5),
    ],
)
def test_faults_of_the_rock_slow_the_progress_of_every_impact(fault, factor):
    simulation = SilentDrill(FULL)

    def progress_until(seconds):
        """Give the progress for the energy that the impacts left since the last call."""
        before = simulation.depth
        energies = simulation.advance_to(seconds * SECOND).impacts["energy_transferred"]
        return (simulation.depth - before) / np.maximum(energies, 0.0).sum()

    healthy = progress_until(1)
    simulation.inject(fault)
    assert progress_until(3) == pytest.approx(factor * healthy, rel=1e-9)
    simulation.clear()
    before = simulation.depth
    assert progress_until(4) == pytest.approx(healthy, rel=1e-9)
    assert simulation.penetration_rate == pytest.approx(simulation.depth - before, rel=1e-9)


OFF = Fault("off", "wrench")
JAM = Fault("free_mass_jammed")


def test_faults_are_numbered_from_one_and_keep_their_times():
    faults = FaultLedger()
    assert (faults.inject(10, OFF), faults.inject(20, JAM)) == (1, 2)
    with pytest.raises(ParameterError, match=r"^off on wrench is already there as fault 1$"):
        faults.inject(25, OFF)
    assert faults.inject(25, Fault("off", "drill_tool")) == 3  # the refused one took no number
    assert faults.clear(30, 1) == FaultRecord(1, OFF, 10, 30)
    assert [record.number for record in faults.active] == [2, 3]
    assert faults.active is faults.since(30)  # the same object until something changes
    # A block sees the faults that ended in it.
    assert [record.number for record in faults.since(29)] == [1, 2, 3]
    assert faults.inject(40, OFF) == 4


@pytest.mark.parametrize("number", [0, 2, None, "1", 10**400])
def test_what_does_not_last_cannot_end(number):
    faults = FaultLedger()
    faults.inject(0, OFF)
    for _ in range(2):
        with pytest.raises(ParameterError, match=r"^there is no fault .* to clear$"):
            faults.clear(5, number)
        number = faults.clear_all(6) or 1  # has ended


def test_of_many_cleared_faults_the_oldest_are_only_counted():
    faults = FaultLedger()
    lasting = faults.inject(0, JAM)
    for time in range(MOST_CLEARED + 5):
        faults.clear(time, faults.inject(time, OFF))
    assert faults.forgotten == 5
    numbers = [record.number for record in faults.records]
    assert numbers == [lasting, *range(7, MOST_CLEARED + 7)]
