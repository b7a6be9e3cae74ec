"""Steps of the slow processes: as short as the load spring of an arm needs."""

import numpy as np
import pytest
from silent_drill import SilentDrill
from support import refusal

from rpud_sim.drilling.process import STIFFEST, Process, parts_of
from rpud_sim.simulation import to_configuration
from rpud_sim.simulation.configuration import to_settings

MILLISECOND = 1_000_000
ARM = {"feed_model": "arm", "initial_feed": 0.005}
STIFF = ARM | {"load_spring_rate": 1e5, "initial_feed": 6e-4}


@pytest.mark.parametrize(
    ("rate", "parts"), [(0.0, 1), (44.7, 1), (62.5, 1), (62.6, 2), (200.0, 4), (500.0, 8)]
)
def test_a_step_is_at_most_a_sixteenth_of_a_radian_of_the_load_spring(rate, parts):
    assert parts_of(rate * rate) == parts
    assert rate * 1e-3 / parts <= 1.0 / 16.0


def steps(simulation, end):
    """Times of the steps up to an end [ms]."""
    found = set()
    for time in range(simulation.time, end * MILLISECOND + 1, MILLISECOND // 16):
        simulation.advance_to(time)
        found.add(simulation.process.time)
    return np.diff(sorted(found)).tolist()


def test_the_default_arm_has_steps_of_a_millisecond_and_a_stiff_one_of_an_eighth():
    assert steps(SilentDrill(to_configuration(ARM)), 3) == [MILLISECOND] * 3
    assert steps(SilentDrill(to_configuration(STIFF)), 1) == [MILLISECOND // 8] * 8
    # Without an arm nothing depends on the load spring.
    alone = {"strata": "sandstone", "load_spring_rate": 1e5}
    assert steps(SilentDrill(to_configuration(alone)), 2) == [MILLISECOND] * 2


@pytest.mark.parametrize("stops", [(), (1_100_000, 1_130_000), (1_125_000, 1_999_999, 2_000_000)])
def test_steps_follow_a_change_of_the_load_spring_wherever_a_caller_stops(stops):
    settings = to_settings(ARM)
    simulation = SilentDrill(settings.configuration, 0.2)
    ends = sorted({*stops, 1_050_000, 2_050_000, 4_000_000})
    for end in ends:
        simulation.advance_to(end)
        if end == 1_050_000:
            simulation.configure(settings.replace({"load_spring_rate": 2e4}).configuration)
        if end == 2_050_000:
            simulation.configure(settings.configuration)
    whole = SilentDrill(settings.configuration, 0.2)
    whole.advance_to(1_050_000)
    whole.configure(settings.replace({"load_spring_rate": 2e4}).configuration)
    whole.advance_to(2_050_000)
    whole.configure(settings.configuration)
    whole.advance_to(4_000_000)
    assert simulation.process == whole.process
    assert simulation.process.time == 4 * MILLISECOND


def test_a_load_spring_that_is_too_stiff_for_an_arm_is_refused_at_any_time():
    text = (
        "load_spring_rate = 200000 N/m is outside its range [0.001, 125000] N/m with "
        "feed_model = arm and rpud_mass = 0.5 kg"
    )
    values = {"rpud_mass": 0.5, "load_spring_rate": 2e5}
    assert refusal(to_configuration, ARM | values) == text
    light = to_settings(ARM | {"rpud_mass": 0.5})
    assert refusal(light.replace, {"load_spring_rate": 2e5}) == text
    to_configuration(ARM | {"rpud_mass": 0.5, "load_spring_rate": 0.5 * STIFFEST})
    to_configuration(values)  # without an arm


def test_a_longer_interval_is_divided_as_well(monkeypatch):
    monkeypatch.setattr(Process, "interval", 4 * MILLISECOND)
    assert steps(SilentDrill(to_configuration(STIFF)), 1) == [MILLISECOND // 2] * 2
