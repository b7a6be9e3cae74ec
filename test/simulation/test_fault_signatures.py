"""Each fault of a drill on an arm has the signature that the documentation gives for it."""

import copy
import functools
from pathlib import Path

import numpy as np
import pytest

from rpud_sim.drilling.bit import BitParameters, cut, radius_of
from rpud_sim.drilling.strata import preset_layer
from rpud_sim.simulation import Fault, Feed, Simulation, to_configuration
from rpud_sim.simulation.faults import KINDS

DOCUMENTATION = Path(__file__).parents[2] / "docs" / "reference" / "faults.md"
SECOND = 1_000_000_000
PERIOD = SECOND // 20  # of the telemetry
DRILL = to_configuration(
    {
        "strata": "sandstone",
        "rotation_model": "friction_drive",
        "feed_model": "arm",
        "arm_stiffness": 2e5,
        "load_spring_rate": 8000.0,
        "initial_feed": 1e-3,
        "actuator_model": "resonance",
        "generator": "tracking",
        "motional_resistance": 25.0,
    }
)
FEED = Feed("rate", 1.9e-4)  # that the healthy drill keeps up with
COLUMNS = ("torque", "rate of penetration", "percussion", "weight on bit", "current")
# Kinds of which the cause remains when the fault has ended.
LEFT_BEHIND = ("bit_walk", "choking")
# Kinds of the feed: the force that they took comes back slowly.
FED = ("feed_stall", "arm_slip")


def signatures():
    """The table of the documentation: what each kind does to each column."""
    lines = [line.split("|")[1:-1] for line in DOCUMENTATION.read_text().splitlines()]
    rows = [[cell.strip(" `") for cell in line] for line in lines if line]
    first = next(number for number, row in enumerate(rows) if row[0] == "signature of")
    assert tuple(rows[first][1:]) == COLUMNS
    found = {}
    for row in rows[first + 2 :]:
        if len(row) != 1 + len(COLUMNS) or row[0] not in KINDS:
            break
        found[row[0]] = dict(zip(COLUMNS, row[1:], strict=True))
    return found


SIGNATURES = signatures()


def measured(simulation, seconds):
    """Means of the columns over the last two seconds of a run."""
    table, start = [], simulation.time
    for end in range(start + PERIOD, start + round(seconds * SECOND) + 1, PERIOD):
        block = simulation.advance_to(end)
        process = block.process
        table.append(
            (
                process.rotation.torque,
                process.borehole.depth,
                len(block.impacts) * SECOND / PERIOD,
                process.mount.weight_on_bit,
                block.actuator.current,
            )
        )
    last = np.array(table[-2 * SECOND // PERIOD :])
    means = last.mean(axis=0)
    means[1] = (last[-1, 1] - last[0, 1]) / (len(last) - 1) * SECOND / PERIOD
    return dict(zip(COLUMNS, means.tolist(), strict=True))


@functools.cache
def started(seconds):
    """A drill at the beginning of its hole, and after some seconds."""
    simulation = Simulation(DRILL, 0.3)
    simulation.apply(FEED)
    simulation.advance_to(round(seconds * SECOND))
    return simulation


@functools.cache
def healthy(seconds):
    return measured(copy.deepcopy(started(seconds)), 5)


def test_the_table_has_a_row_for_each_fault_of_a_drill_on_an_arm():
    own = list(KINDS)[list(KINDS).index("binding") : list(KINDS).index("off")]
    assert {*SIGNATURES} == {*own, "choking"}


@pytest.mark.parametrize("kind", SIGNATURES)
def test_a_fault_has_its_signature_and_its_end_brings_the_torque_back(kind):
    begun = 1.0 if kind == "bit_walk" else 6.0
    simulation = copy.deepcopy(started(begun))
    number = simulation.inject(Fault(kind))
    before, during = healthy(begun), measured(simulation, 5)
    changes = {column: during[column] / before[column] - 1.0 for column in COLUMNS}
    found = {
        column: change
        for column, change in changes.items()
        if not {
            "up": change > 0.03,
            "down": change < -0.03,
            "little": abs(change) < 0.1,
        }[SIGNATURES[kind][column]]
    }
    assert not found, changes

    simulation.clear(number)
    after = measured(simulation, 2)
    bit = BitParameters()
    radius = radius_of(DRILL.rock.hole_area)
    sharp = cut(bit, preset_layer("sandstone"), radius, after["weight on bit"], bit.bit_wear_flat)
    assert after["torque"] == pytest.approx(sharp.cutting_torque + sharp.friction_torque, rel=0.1)
    if kind in FED:
        mount = simulation.process.mount
        assert mount.rate == pytest.approx(FEED.value)
        assert simulation.advance_to(simulation.time + SECOND).process.mount.slip == mount.slip
    elif kind not in LEFT_BEHIND:
        assert after["rate of penetration"] > 0.8 * before["rate of penetration"]
