"""Quantities as people see them: three right digits, and a unit."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.foundation.shown_quantities import QUANTITIES, number_text


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("peak_force", 43_799.0, "43.8 kN"),
        ("peak_force", 1234.0, "1.23 kN"),
        ("depth", 1.247e-99, "0 mm"),
        ("penetration_rate", 5.5e-5, "3.3 mm/min"),
        ("reacting_force", -14.1049, "-14.1 N"),
        ("impact_rate", 450.4, "450 /s"),
        ("drill_tool", 1.2e-6, "0.0012 mm"),
        ("drill_tool", 7.19e-9, "0 mm"),
        ("electrical_power", math.nan, "–"),
        ("electrical_power", None, "–"),
    ],
)
def test_a_value_reads_as_people_write_it(name, value, text):
    assert QUANTITIES[name].text(value) == text


@given(st.floats(1e-6, 1e9))
def test_three_digits_are_right(value):
    assert float(number_text(value)) == pytest.approx(value, rel=5e-3)
    assert number_text(-value) == f"-{number_text(value)}"
