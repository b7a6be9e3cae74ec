"""Error rates of `rpud compare`: false alarms between runs of one drill, and changes it finds.

Run `python -m bench.compare_study [PAIRS]`. Each pair of runs has two initial phases. A pair counts
as an alarm if any of its figures differs, after Holm's correction.
"""

from __future__ import annotations

import sys

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.compare.comparison import compare_values
from rpud_sim.inspection.compare.estimates import DIFFERS
from rpud_sim.inspection.compare.quantities import IMPACTS
from rpud_sim.inspection.compare.recorded_drill import Origins, RecordedDrill
from rpud_sim.inspection.compare.recorded_values import RecordedValues
from rpud_sim.inspection.compare.windows import Window
from rpud_sim.simulation import Parameters, Simulation, Times, preset

SETTLE = 0.5
RATE = 100
COLUMNS = ("peak_force", "impact_velocity", "energy", "contact_duration")


def simulated_values(parameters: Parameters, phase: float, duration: int) -> RecordedValues:
    """Return the values of a run of whole seconds, as a bag of it would give them."""
    simulation = Simulation(parameters, phase)
    impacts, forces, positions = [], [], []
    for second in range(duration):
        block = simulation.advance_to((second + 1) * SECOND)
        impacts.append(block.impacts.copy())
        samples = block.sample(Times.from_grid(second * RATE, RATE, RATE))
        forces.append(samples.reacting_force.copy())
        positions.append(samples.nodal_plane_position.copy())
    found = np.concatenate(impacts)
    times = np.arange(duration * RATE) / RATE
    origin = Origins(np.zeros(1, np.int64), np.zeros(1, np.int64))
    return RecordedValues(
        RecordedDrill("", "", 1, 1, 0, 0, origin),
        {
            IMPACTS: {
                "time": found["seconds"] + found["fraction"],
                "sequence": found["sequence"].astype(np.int64),
                **{name: found[name] for name in COLUMNS},
            },
            "reacting_force": {"time": times, "force": np.concatenate(forces)},
            "nodal_plane": {"time": times, "position": np.concatenate(positions)},
        },
    )


def alarms(
    first: Parameters, second: Parameters, duration: int, pairs: int, seed: int = 5
) -> np.ndarray:
    """Return for each pair of runs how many figures differ."""
    phases = np.random.default_rng(seed).random((pairs, 2))
    window = Window("whole time", (SETTLE,) * 2, (float(duration),) * 2)
    counts = []
    for phase, other in phases.tolist():
        runs = [
            simulated_values(first, phase, duration),
            simulated_values(second, other, duration),
        ]
        [found] = compare_values(runs, [window])
        differences = [each for q in found.quantities for run in q.differences for each in run]
        counts.append(sum(each.decision == DIFFERS for each in differences))
    return np.array(counts)


def main() -> None:
    """Print the rates."""
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    drilling, free = preset("drilling"), preset("free")
    cases = [("same drill, drilling", drilling, drilling), ("same drill, free", free, free)]
    cases += [
        (f"{name} {change:+.0%}", drilling, drilling.replace(**{name: value * (1.0 + change)}))
        for name, value, change in (
            ("weight_on_bit", drilling.weight_on_bit, 0.1),
            ("vibration_amplitude", drilling.vibration_amplitude, 0.1),
            ("free_mass", drilling.free_mass, 0.1),
        )
    ]
    print(f"{'runs':28s}{'duration':>10s}{'pairs':>7s}{'found':>8s}")
    for name, first, second in cases:
        for duration in (3, 10, 20):
            found = alarms(first, second, duration, pairs)
            print(f"{name:28s}{duration:8d} s{pairs:7d}{np.mean(found > 0):8.1%}", flush=True)


if __name__ == "__main__":
    main()
