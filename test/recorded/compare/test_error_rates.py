"""Runs of one drill are seldom called different, and changes of a tenth are found."""

import numpy as np
import pytest

from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded.compare.changes import ComparedWindow
from rpud_sim.recorded.compare.comparison import compare_values
from rpud_sim.recorded.compare.estimates import DIFFERS
from rpud_sim.recorded.compare.values import IMPACTS, RecordedValues
from rpud_sim.recorded.runs import RecordedRun
from rpud_sim.simulation import Parameters, Simulation, Times, preset

DRILLING = preset("drilling")
PAIRS = 100
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
    return RecordedValues(
        RecordedRun("", "/journal"),
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
    window = ComparedWindow("whole time", (SETTLE,) * 2, (float(duration),) * 2)
    counts = []
    for phase, other in phases.tolist():
        runs = [
            simulated_values(first, phase, duration),
            simulated_values(second, other, duration),
        ]
        _, differences = compare_values(runs, [window])
        counts.append(sum(each.decision == DIFFERS for each in differences))
    return np.array(counts)


def test_false_alarms_are_as_rare_as_it_says():
    # With 5 % and 100 pairs, more than 13 alarms have a probability of 0.05 %.
    found = alarms(DRILLING, DRILLING, 2, PAIRS)
    assert np.count_nonzero(found) <= 13


@pytest.mark.parametrize("name", ["weight_on_bit", "vibration_amplitude"])
def test_a_change_of_a_tenth_is_found(name):
    other = DRILLING.replace(**{name: 1.1 * getattr(DRILLING, name)})
    assert np.count_nonzero(alarms(DRILLING, other, 20, 3)) == 3
