"""Signatures of the faults of a drill on an arm: how they are measured, and the table of the page.

`make signatures` prints the table of docs/reference/faults.md.
"""

import copy
import functools
import itertools
from pathlib import Path

import numpy as np
from silent_drill import SilentDrill

from rpud_sim.simulation import Fault, Feed, to_configuration
from rpud_sim.simulation.fault_kinds import KINDS, _arm, _hole, _rotation

DOCUMENTATION = Path(__file__).parents[2] / "docs" / "reference" / "faults.md"
SECOND = 1_000_000_000
PERIOD = SECOND // 20  # of the telemetry
DRILL = to_configuration(
    {
        "strata": "limestone",
        "rotation_model": "friction_drive",
        "feed_model": "arm",
        "arm_stiffness": 2e5,
        "rotor_stall_torque": 0.5,
        "load_spring_rate": 11000.0,
        "initial_feed": 1e-3,
        "actuator_model": "resonance",
        "generator": "tracking",
        "motional_resistance": 25.0,
    }
)
FEED = Feed("rate", 7e-4)  # that the healthy drill keeps up with
START = 2.0  # s, when the fault begins
WINDOW = 3.0  # s, of which means are taken, at the end of the fault
LASTING = 6.0  # s, of a fault until its end is looked at
# The weight on bit changes slowly.
LASTING_LONGER = {"choking": 8.0, "feed_stall": 8.0, "arm_slip": 8.0}
PHASES = (0.05, 0.35, 0.65)  # of the vibration at time zero [cycles]

# No change is a mean within the band of the healthy one, at each phase.
BANDS = {
    "torque": 0.14,
    "rate of penetration": 0.18,
    "percussion": 0.14,
    "weight on bit": 0.12,
    "current": 0.2,
}
COLUMNS = tuple(BANDS)
# Kinds that a drill without rotation, feed and layers cannot have.
ON_AN_ARM_ALONE = [name for name, kind in KINDS.items() if {_rotation, _arm, _hole} & {*kind.needs}]
ROWS = (ON_AN_ARM_ALONE[0], "choking", *ON_AN_ARM_ALONE[1:])


def started(phase):
    """Return a healthy drill in its hole at the time at which faults begin."""
    return copy.deepcopy(_started(phase))


@functools.cache
def _started(phase):
    simulation = SilentDrill(DRILL, phase)
    simulation.apply(FEED)
    simulation.advance_to(round(START * SECOND))
    return simulation


def measured(simulation, seconds, window=WINDOW):
    """Return the mean of each column over the last part of a run [SI units]."""
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
    last = np.array(table[-round(window * SECOND) // PERIOD :])
    means = last.mean(axis=0)
    means[1] = (last[-1, 1] - last[0, 1]) / (len(last) - 1) * SECOND / PERIOD
    return means


@functools.cache
def faulty_means(phase, kind):
    """Return the means of a run with a fault, and the run at the end of these."""
    simulation = started(phase)
    simulation.inject(Fault(kind))
    return measured(simulation, LASTING_LONGER.get(kind, LASTING)), simulation


@functools.cache
def healthy_mean():
    return np.mean([measured(started(phase), LASTING, LASTING) for phase in PHASES], axis=0)


@functools.cache
def changes(kind):
    """Changes of the means by a fault, as shares of the healthy ones, shape (phases, columns)."""
    return np.array([faulty_means(phase, kind)[0] for phase in PHASES]) / healthy_mean() - 1.0


def signature(kind):
    """Words of a row of the table; ``?`` where some phases are in the band and others outside."""
    words = {}
    for column, change in zip(COLUMNS, changes(kind).T, strict=True):
        cells = {"same" if abs(x) < BANDS[column] else "up" if x > 0.0 else "down" for x in change}
        words[column] = cells.pop() if len(cells) == 1 else "?"
    return words


def documented():
    """Return the table of signatures of the page, by kind and column."""
    lines = DOCUMENTATION.read_text().splitlines()
    rows = [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in lines]
    first = next(number for number, row in enumerate(rows) if row and row[0] == "signature of")
    assert tuple(rows[first][1:]) == COLUMNS
    table = itertools.takewhile(len, rows[first + 2 :])
    return {kind: dict(zip(COLUMNS, cells, strict=True)) for kind, *cells in table}


if __name__ == "__main__":
    print(f"| {' | '.join(('signature of', *COLUMNS))} |\n|{'---|' * (1 + len(COLUMNS))}")
    for kind in ROWS:
        print(f"| `{kind}` | {' | '.join(signature(kind).values())} |")
