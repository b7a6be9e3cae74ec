"""Every parameter at the ends of its range: the motion stays finite, or one line says why not."""

import itertools
import math

import numpy as np
import pytest

from rpud_sim.foundation.parameters import quantities
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.engine import EngineError
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.simulation import Simulation

MILLISECOND = 1_000_000
KINDS = (("free", "gain"), ("drilling", "gain"), ("drilling", "resonance"))
NUMBERS = {**quantities(Parameters), **quantities(ActuatorParameters)}


def ends(allowed):
    least = math.nextafter(allowed.minimum, math.inf) if allowed.exclusive else allowed.minimum
    most = math.nextafter(allowed.maximum, -math.inf) if allowed.below else allowed.maximum
    return float(least), float(most)


def check(simulation, until):
    block = simulation.advance_to(until)
    for records in (block.segments, block.impacts):
        for name in records.dtype.names:
            assert np.isfinite(records[name]).all(), name
    assert math.isfinite(block.actuator.amplitude)


@pytest.mark.parametrize("name", NUMBERS)
def test_the_motion_is_finite_at_the_ends_of_the_range(name):
    kinds = KINDS[:1] if name == "free_mass" else KINDS  # at its end each takes seconds
    for value, (regime, model) in itertools.product(ends(NUMBERS[name]), kinds):
        values = {"regime": regime, "actuator_model": model, name: value}
        if model == "resonance":
            values |= {"generator": "tracking", "heating": True}
        if name.startswith("effective_tool"):
            values["contact_model"] = "given"
        try:
            simulation = Simulation(to_configuration(values))
            for until in (1, 2, 5):
                check(simulation, until * MILLISECOND)
        except ParameterError:  # values that do not go together
            continue
        except EngineError as error:
            if "events" not in str(error):
                raise
