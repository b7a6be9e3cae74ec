"""A single contact against the engine."""

import numpy as np
import pytest

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.contact import CONTACT_MODELS, single_contact
from rpud_sim.simulation import preset
from rpud_sim.simulation.simulation import Simulation


@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_an_undisturbed_impact_of_the_engine_is_a_single_contact(model):
    """Eqs. (36)-(39) against what the engine does with the same blow."""
    parameters = preset("drilling").replace(contact_model=model, gravity=0.0)
    # The first one is the start, with the actuator upon the free mass.
    impacts = Simulation(parameters).advance_to(5 * SECOND).impacts[1:]
    contacts = [single_contact(parameters, float(v)) for v in impacts["impact_velocity"]]
    durations = np.array([contact.duration for contact in contacts])
    undisturbed = np.abs(impacts["contact_duration"] / durations - 1.0) < 1e-6

    assert np.count_nonzero(undisturbed) > 0.5 * len(impacts)
    forces = np.array([contact.peak_force for contact in contacts])[undisturbed]
    np.testing.assert_allclose(impacts["peak_force"][undisturbed], forces, rtol=1e-6)
