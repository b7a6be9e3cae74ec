"""Signatures of the faults of a drill on an arm: how they are measured, and the table of the page.

`make signatures` prints the table of docs/reference/faults.md and writes signatures.csv beside it.
"""

import argparse
import copy
import csv
import dataclasses
import functools
import itertools
from pathlib import Path

import numpy as np
from scipy.stats import t

from rpud_sim.simulation import Fault, Feed, Simulation, to_configuration
from rpud_sim.simulation.fault_kinds import KINDS, _feed, _hole, _rotation

REFERENCE = Path(__file__).parents[1] / "docs" / "reference"
DOCUMENTATION = REFERENCE / "faults.md"
CHANGES = REFERENCE / "signatures.csv"
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
FEED = Feed("rate", 5.4e-4)  # that the healthy drill keeps up with
START = 2.0  # s, when the fault begins
WINDOW = 3.0  # s, of which means are taken, at the end of the fault
LASTING = 6.0  # s, of a fault until its end is looked at
# The weight on bit changes slowly.
LASTING_LONGER = {"choking": 8.0, "feed_stall": 8.0, "arm_slip": 8.0}
PHASES = (0.05, 0.35, 0.65)  # of the vibration at time zero [cycles]

# No change is a mean within the band of the healthy one. Effects are well inside or well outside.
BANDS = {
    "torque": 0.14,
    "rate of penetration": 0.18,
    "percussion": 0.14,
    "weight on bit": 0.12,
    "current": 0.2,
}
COLUMNS = tuple(BANDS)
CONFIDENCE = 0.99
# Kinds that a drill without rotation, feed and layers cannot have.
ON_AN_ARM_ALONE = [
    name for name, kind in KINDS.items() if {_rotation, _feed, _hole} & {*kind.needs}
]
ROWS = (ON_AN_ARM_ALONE[0], "choking", *ON_AN_ARM_ALONE[1:])


@dataclasses.dataclass(frozen=True)
class Effect:
    """Change of a mean by a fault, as a share of the healthy mean.

    Args:
        change: its mean over the initial phases.
        error: half of its interval.
        band: of no change.
    """

    change: float
    error: float
    band: float

    @property
    def cell(self):
        """The word of the table; empty where the interval has a part in the band."""
        if self.change - self.error > self.band:
            return "up"
        if self.change + self.error < -self.band:
            return "down"
        return "same" if abs(self.change) + self.error < self.band else ""

    @property
    def margin(self):
        """Distance of the interval from the edge of the band; negative if it is across."""
        return abs(abs(self.change) - self.band) - self.error


def started(phase):
    """Return a healthy drill in its hole at the time at which faults begin."""
    return copy.deepcopy(_started(phase))


@functools.cache
def _started(phase):
    simulation = Simulation(DRILL, phase)
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


def healthy_means(phase):
    """Return the means of a healthy run, after its start."""
    return measured(started(phase), LASTING, LASTING)


def faulty_means(phase, kind):
    """Return the means of a run with a fault, and the run at the end of these."""
    simulation = started(phase)
    simulation.inject(Fault(kind))
    return measured(simulation, LASTING_LONGER.get(kind, LASTING)), simulation


def effects(healthy, faulty):
    """Return the effect of each kind on each column.

    The scatter over the phases is taken as a share of the greater of the healthy mean and that of
    the fault, and pooled over the rows: three phases alone would give a poor estimate of it. It
    is counted twice, for the healthy runs and for those of the fault.

    Args:
        healthy: means of the healthy runs, shape (phases, columns).
        faulty: of each kind, of the same shape.
    """
    count = len(healthy)
    reference = healthy.mean(axis=0)
    levels = {kind: means.mean(axis=0) / reference for kind, means in faulty.items()}
    shares = [healthy / reference - 1.0]
    for kind, means in faulty.items():
        shares.append((means / reference - levels[kind]) / np.maximum(levels[kind], 1.0))
    freedom = len(shares) * (count - 1)
    scatter = np.sqrt(sum((share**2).sum(axis=0) for share in shares) / freedom)
    factor = t.ppf(0.5 + CONFIDENCE / 2.0, freedom) * np.sqrt(2.0 / count)
    return {
        kind: {
            column: Effect(
                float(level[i] - 1.0),
                float(factor * scatter[i] * max(level[i], 1.0)),
                BANDS[column],
            )
            for i, column in enumerate(COLUMNS)
        }
        for kind, level in levels.items()
    }


def documented():
    """Return the table of signatures of the page, by kind and column."""
    lines = DOCUMENTATION.read_text().splitlines()
    rows = [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in lines]
    first = next(number for number, row in enumerate(rows) if row and row[0] == "signature of")
    assert tuple(rows[first][1:]) == COLUMNS
    table = itertools.takewhile(len, rows[first + 2 :])
    return {kind: dict(zip(COLUMNS, cells, strict=True)) for kind, *cells in table}


def documented_changes():
    """Return the changes behind the signatures and their errors, by kind and column."""
    with CHANGES.open(newline="") as file:
        head, *rows = csv.reader(file)
    assert tuple(head[1:]) == COLUMNS
    return {
        kind: {
            column: [float(word) / 100.0 for word in cell.removesuffix(" %").split(" ± ")]
            for column, cell in zip(COLUMNS, cells, strict=True)
        }
        for kind, *cells in rows
    }


def main():
    """Print the signatures and write the changes, from as many phases as wanted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--phases", type=int, default=8, help="initial phases, evenly spaced")
    count = parser.parse_args().phases
    phases = [(number + 0.5) / count for number in range(count)]
    healthy = np.array([healthy_means(phase) for phase in phases])
    faulty = {kind: np.array([faulty_means(phase, kind)[0] for phase in phases]) for kind in ROWS}
    found = effects(healthy, faulty)
    print(f"| {' | '.join(('signature of', *COLUMNS))} |\n|{'---|' * (1 + len(COLUMNS))}")
    for kind, row in found.items():
        print(f"| `{kind}` | {' | '.join(row[column].cell or '?' for column in COLUMNS)} |")
    with CHANGES.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("change by", *COLUMNS))
        for kind, row in found.items():
            shown = (f"{100 * row[c].change:+.0f} ± {100 * row[c].error:.0f} %" for c in COLUMNS)
            writer.writerow((kind, *shown))
    least = min((row[c].margin, kind, c) for kind, row in found.items() for c in COLUMNS)
    print(f"least margin: {100 * least[0]:.1f} % ({least[1]}, {least[2]})")


if __name__ == "__main__":
    main()
