"""Each fault of a drill on an arm has the signature that the documentation gives for it."""

import functools
import itertools

import numpy as np
import pytest
from fault_signatures import (
    BANDS,
    COLUMNS,
    DRILL,
    FEED,
    PHASES,
    ROWS,
    SECOND,
    Effect,
    documented,
    documented_changes,
    effects,
    faulty_means,
    healthy_means,
    started,
)

from rpud_sim.drilling.borehole import BitParameters, cut, radius_of
from rpud_sim.drilling.rock import preset_layer
from rpud_sim.simulation.faults import Fault

# Kinds of which the cause remains when the fault has ended.
LEFT_BEHIND = ("choking",)
# Kinds of the feed: the force that they took comes back slowly.
FED = ("feed_stall", "arm_slip")
SIGNATURES = documented()


@functools.cache
def runs(kind):
    """Means of a kind at each phase, and the run of the first phase."""
    results = [faulty_means(phase, kind) for phase in PHASES]
    return np.array([means for means, _ in results]), results[0][1]


@functools.cache
def healthy():
    return np.array([healthy_means(phase) for phase in PHASES])


@functools.cache
def found():
    return effects(healthy(), {kind: runs(kind)[0] for kind in ROWS})


def test_the_table_has_a_row_for_each_fault_of_a_drill_on_an_arm():
    assert tuple(SIGNATURES) == ROWS
    assert {cell for row in SIGNATURES.values() for cell in row.values()} == {"up", "down", "same"}
    assert len(PHASES) >= 3


@pytest.mark.parametrize("kind", ROWS)
def test_a_fault_has_its_signature(kind):
    """The interval of each mean over the phases is on one side of the edge of no change."""
    assert {column: found()[kind][column].cell for column in COLUMNS} == SIGNATURES[kind]


@pytest.mark.extended
@pytest.mark.parametrize("kind", ROWS)
def test_the_changes_of_the_page_are_those_of_other_phases(kind):
    """They are of eight phases, none of them one of the test's."""
    for column, (change, error) in documented_changes()[kind].items():
        effect = found()[kind][column]
        assert abs(change - effect.change) < error + effect.error + 0.01, (column, effect)
        assert Effect(change, error, BANDS[column]).cell == SIGNATURES[kind][column]


def test_no_two_faults_that_a_recovery_treats_differently_look_alike():
    """Rows that are equal are listed on the page, with what tells them apart."""
    listed = [{"choking", "hard_inclusion"}, set(FED)]
    for one, other in itertools.combinations(ROWS, 2):
        alike = SIGNATURES[one] == SIGNATURES[other]
        assert not alike or any({one, other} <= group for group in listed)


def test_what_tells_equal_rows_apart():
    """Torque over the first part of a fault, and the feed, as the page says."""
    simulation = started(PHASES[0])
    before = simulation.process.rotation.torque
    simulation.inject(Fault("worn_bit"))
    times = simulation.time + np.arange(1, 11) * (SECOND // 20)
    torques = [simulation.advance_to(int(time)).process.rotation.torque for time in times]
    assert np.mean(torques) < 0.9 * before
    force = {kind: found()[kind]["weight on bit"] for kind in ("binding", "corkscrewing")}
    assert force["binding"].change - force["binding"].error > 0.0
    assert force["corkscrewing"].change + force["corkscrewing"].error < 0.0
    rates = {kind: runs(kind)[1].process.mount.rate for kind in FED}
    assert rates == pytest.approx({"feed_stall": 0.0, "arm_slip": FEED.value})
    assert runs("arm_slip")[1].process.mount.slip < 0.0  # away from the rock


@pytest.mark.parametrize("kind", ROWS)
def test_the_end_of_a_fault_brings_the_torque_back(kind):
    _, simulation = runs(kind)
    assert simulation.faults.active[0].fault == Fault(kind)
    simulation.clear(simulation.faults.active[0].number)
    start, depth = simulation.time, simulation.depth
    blocks = [simulation.advance_to(start + n * SECOND // 20) for n in range(1, 41)]
    force = sum(block.impacts["impulse"].sum() for block in blocks) / 2.0  # on the rock
    torque = np.mean([block.process.rotation.torque for block in blocks])
    bit, radius = BitParameters(), radius_of(DRILL.rock.hole_area)
    sharp = cut(bit, preset_layer("limestone"), radius, force, bit.bit_wear_flat)
    # The flutes have little in them at this depth.
    expected = sharp.cutting_torque + sharp.friction_torque
    assert torque == pytest.approx(expected, rel=0.1, abs=3e-5)
    if kind in FED:
        mount = simulation.process.mount
        assert mount.rate == pytest.approx(FEED.value)
        assert simulation.advance_to(simulation.time + SECOND).process.mount.slip == mount.slip
    elif kind not in LEFT_BEHIND:
        before = dict(zip(COLUMNS, healthy().mean(axis=0), strict=True))
        assert (simulation.depth - depth) / 2.0 > 0.8 * before["rate of penetration"]


def test_an_interval_across_the_edge_of_no_change_is_no_cell():
    for change, cell in ((0.2, "up"), (-0.2, "down"), (0.05, "same"), (0.11, ""), (-0.09, "")):
        assert Effect(change, 0.02, 0.1).cell == cell
    assert Effect(0.2, 0.02, 0.1).margin == pytest.approx(0.08)
    assert Effect(0.09, 0.02, 0.1).margin == pytest.approx(-0.01)
