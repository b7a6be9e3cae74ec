"""Parameters are checked once, by name, and a refusal is one clear line."""

import dataclasses
import math

import pytest
from drill_configurations import tables
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.parameters import NAMES, QUANTITIES, Parameters, preset

NUMBERS = st.sampled_from(sorted(QUANTITIES))


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


@given(name=NUMBERS, value=st.sampled_from([math.nan, math.inf, -math.inf, True, "1", None, [1]]))
def test_what_is_no_finite_number_is_refused(name, value):
    with pytest.raises(ParameterError, match=f"^{name} = ") as refusal:
        Parameters().replace(**{name: value})
    assert "\n" not in str(refusal.value)


@given(name=NUMBERS, sign=st.sampled_from([-1, 1]))
def test_what_is_out_of_range_is_refused_with_name_value_unit_and_range(name, sign):
    quantity = QUANTITIES[name]
    value = quantity.maximum * 2.0 + 1.0 if sign > 0 else quantity.minimum - 1.0
    with pytest.raises(ParameterError) as refusal:
        Parameters().replace(**{name: value})
    message = str(refusal.value)
    assert message.startswith(f"{name} = {value:g}")
    assert quantity.unit in message
    assert quantity.range in message


@given(name=NUMBERS)
def test_the_bounds_themselves_are_allowed_unless_they_are_open(name):
    quantity = QUANTITIES[name]
    for value, is_open in (
        (quantity.minimum, quantity.exclusive),
        (quantity.maximum, quantity.below),
    ):
        if is_open:
            with pytest.raises(ParameterError):
                Parameters().replace(**{name: value})
        else:
            assert getattr(Parameters().replace(**{name: value}), name) == value


@pytest.mark.parametrize(("name", "value"), [("regime", "x"), ("contact_model", 3)])
def test_choices(name, value):
    with pytest.raises(ParameterError, match=f"^{name} = {value!r} is not one of "):
        Parameters(**{name: value})


def test_unknown_names_are_refused():
    with pytest.raises(
        ParameterError, match=r"^mass is not a parameter; did you mean rpud_mass\?$"
    ):
        Parameters().replace(mass=1.0)


def test_every_number_has_a_quantity_and_nothing_changes_in_place():
    others = {"contact_model", "gravity_on_drill", "regime"}
    assert set(NAMES) == {*QUANTITIES, *others}
    with pytest.raises(dataclasses.FrozenInstanceError):
        Parameters().gravity = 1.0
