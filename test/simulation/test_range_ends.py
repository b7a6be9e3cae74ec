"""Every parameter at the ends of its range: the motion stays finite, or one line says why not."""

import itertools
import math

import numpy as np
import pytest

from rpud_sim.foundation.parameters import declarations
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.model.engine import EngineError
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.simulation import Simulation

MILLISECOND = 1_000_000
KINDS = (("free", "gain"), ("drilling", "gain"), ("drilling", "resonance"))


def ends(allowed):
    least = math.nextafter(allowed.minimum, math.inf) if allowed.exclusive else allowed.minimum
    most = math.nextafter(allowed.maximum, -math.inf) if allowed.below else allowed.maximum
    return float(least), float(most)


NUMBERS = {
    name: ends(declaration.allowed)
    for group in (Parameters, ActuatorParameters)
    for name, declaration in declarations(group).items()
    if isinstance(declaration.allowed, Quantity)
}


def check(simulation, until):
    block = simulation.advance_to(until)
    for name in block.segments.dtype.names:
        assert np.isfinite(block.segments[name]).all(), name
    for name in block.impacts.dtype.names:
        assert np.isfinite(block.impacts[name]).all(), name
    assert math.isfinite(block.actuator.amplitude)


@pytest.mark.parametrize("name", NUMBERS)
def test_the_motion_is_finite_at_the_ends_of_the_range(name):
    kinds = KINDS[:1] if name == "free_mass" else KINDS  # at its end each takes seconds
    for value, (regime, model) in itertools.product(NUMBERS[name], kinds):
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
            reason = str(error)
        else:
            continue
        assert "events" in reason
