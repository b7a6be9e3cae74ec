"""Each fault of a drill on an arm has the signature that the documentation gives for it."""

import copy
import itertools

import numpy as np
import pytest
from fault_signatures import (
    COLUMNS,
    DRILL,
    FEED,
    PHASES,
    ROWS,
    SECOND,
    documented,
    faulty_means,
    healthy_mean,
    signature,
)

from rpud_sim.drilling.borehole import BitParameters, cut, radius_of
from rpud_sim.drilling.inputs import Pulses
from rpud_sim.drilling.rock import preset_layer
from rpud_sim.simulation.faults import Fault

# Each needs many drills.
pytestmark = pytest.mark.extended

# Kinds of which the cause remains when the fault has ended.
LEFT_BEHIND = ("choking",)
# Kinds of the feed: the force that they took comes back slowly.
FED = ("feed_stall", "arm_slip")
SIGNATURES = documented()


def test_the_table_has_a_row_for_each_fault_of_a_drill_on_an_arm():
    assert tuple(SIGNATURES) == ROWS
    assert {cell for row in SIGNATURES.values() for cell in row.values()} == {"up", "down", "same"}


@pytest.mark.parametrize("kind", ROWS)
def test_a_fault_has_its_signature(kind):
    assert signature(kind) == SIGNATURES[kind]


def test_no_two_faults_that_a_recovery_treats_differently_look_alike():
    """Rows that are equal are listed on the page, with what tells them apart."""
    listed = [{"choking", "hard_inclusion"}, set(FED)]
    for one, other in itertools.combinations(ROWS, 2):
        alike = SIGNATURES[one] == SIGNATURES[other]
        assert not alike or any({one, other} <= group for group in listed)


def test_what_tells_equal_rows_apart():
    """The feed and the host, as the page says."""
    stalled, slipping = (faulty_means(PHASES[0], kind)[1].process.mount for kind in FED)
    assert (stalled.rate, slipping.rate) == pytest.approx((0.0, FEED.value))
    assert slipping.slip < 0.0  # away from the rock


@pytest.mark.parametrize("kind", ROWS)
def test_the_end_of_a_fault_brings_the_torque_back(kind):
    simulation = copy.deepcopy(faulty_means(PHASES[0], kind)[1])
    assert simulation.faults.active[0].fault == Fault(kind)
    simulation.clear(simulation.faults.active[0].number)
    start, depth = simulation.time, simulation.depth
    blocks = [simulation.advance_to(start + n * SECOND // 20) for n in range(1, 41)]
    force = sum(block.impacts["impulse"].sum() for block in blocks) / 2.0  # on the rock
    torque = np.mean([block.process.rotation.torque for block in blocks])
    bit, radius = BitParameters(), radius_of(DRILL.rock.hole_area)
    impacts = np.concatenate([block.impacts for block in blocks])
    pulses = Pulses(
        len(impacts) / 2.0, impacts["impulse"].mean(), impacts["contact_duration"].mean()
    )
    limestone = preset_layer("limestone")
    sharp = cut(bit, limestone, radius, force, bit.bit_wear_flat, 1.0, pulses)
    # The flutes have little in them at this depth.
    expected = sharp.cutting_torque + sharp.friction_torque
    assert torque == pytest.approx(expected, rel=0.1, abs=3e-5)
    if kind in FED:
        mount = simulation.process.mount
        assert mount.rate == pytest.approx(FEED.value)
        assert simulation.advance_to(simulation.time + SECOND).process.mount.slip == mount.slip
    elif kind not in LEFT_BEHIND:
        before = healthy_mean()[COLUMNS.index("rate of penetration")]
        assert (simulation.depth - depth) / 2.0 > 0.8 * before
