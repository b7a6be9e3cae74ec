"""Parameters are checked once, by name, and a refusal is one clear line."""

import pytest
from drill_configurations import tables

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.parameters import preset


def test_the_tables_of_the_paper():
    free, drilling = tables("free"), tables("drilling")
    for table in (free, drilling):
        assert (table.rpud_mass, table.vibration_frequency) == (1.0, 16000.0)
        assert (table.vibration_amplitude, table.load_spring_rate) == (35e-6, 2000.0)
        assert (table.rpud_damping_ratio, table.free_mass) == (0.5, 5e-3)
    assert (free.drill_tool_mass, free.restoring_spring_rate) == (13.5e-3, 2000.0)
    assert (free.weight_on_bit, drilling.weight_on_bit) == (0.0, 10.0)
    assert drilling.elastic_modulus == 1.96e11
    with pytest.raises(ParameterError, match=r"regime = 'lunar' is not one of free, drilling"):
        preset("lunar")
