"""Readings of the paper: their product, their words, and what none of them reproduces."""

import dataclasses

from rpud_sim.studies.reproduction.paper_numbers import NUMBERS
from rpud_sim.studies.reproduction.readings import Fit, Reading, Value, all_readings, not_reproduced


def test_readings_are_the_full_product():
    readings = all_readings()

    assert len(readings) == len(set(readings)) == 2 * 7 * 2 * 2 * 2
    assert {reading.parameters("free").weight_on_bit for reading in readings} == {0.0}


def test_a_number_that_no_reading_reproduces_is_named():
    reading = all_readings()[0]
    values = {number.key: Value(number.paper, 0.0, 0.0, 0.0) for number in NUMBERS}
    values["contact_peak_force"] = Value(1650.0 * 1.11, 0.0, 0.0, 0.0)
    fit = Fit(reading, values, 0.0, (0.0, 0.0), 0.0, 0.0, 0)

    assert [entry["key"] for entry in not_reproduced([fit])] == ["contact_peak_force"]
    assert fit.near == len(NUMBERS) - 1
    other = dataclasses.replace(
        fit, values={**values, "contact_peak_force": Value(1650.0 * 1.09, 0.0, 0.0, 0.0)}
    )
    assert not_reproduced([fit, other]) == []


def test_a_reading_names_only_what_matters():
    reading = Reading(17.5e-6, 10.0, 1.96e11, "rayleigh", "both")

    assert reading.describe("contact") == "E = 1.96e+11 Pa, rayleigh contact"
    assert "W = 10 N" not in reading.describe("free")
