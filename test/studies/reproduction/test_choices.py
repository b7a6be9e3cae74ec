"""Choices: the drills they give, and what an impact is said to transfer."""

import dataclasses
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.model.drill import effective_tool
from rpud_sim.simulation import preset
from rpud_sim.studies.reproduction.choices import (
    ENERGIES,
    IMPLIED,
    IMPLIED_MASS,
    IMPLIED_SPRING_RATE,
    SERIES_SPRING_RATE,
    SHAPE_MASS,
    TOOLS,
    Before,
    Reading,
    Rock,
    energy_share,
)
from rpud_sim.studies.reproduction.reproduction import figure_12_implies
from rpud_sim.studies.reproduction.single_contact import single_contact
from rpud_sim.studies.reproduction.wording import plain

MASSES = st.floats(1e-4, 1e-1)


def test_the_tools_that_are_given_follow_from_the_paper():
    drill = preset("drilling")
    shape = effective_tool(drill.replace(contact_model="mode_shape"))
    series = effective_tool(drill.replace(contact_model="rayleigh"))
    implied = figure_12_implies()

    assert pytest.approx(shape.mass, rel=2e-4) == SHAPE_MASS
    assert pytest.approx(series.spring_rate, rel=2e-4) == SERIES_SPRING_RATE
    assert pytest.approx(implied["tool_mass"], rel=4e-3) == IMPLIED_MASS
    assert pytest.approx(implied["tool_spring_rate"], rel=2e-3) == IMPLIED_SPRING_RATE


def test_the_tool_of_figure_12_gives_figure_12():
    contact = single_contact(Rock(tool=IMPLIED, gravity=0.0).parameters(), 5.0)

    assert contact.peak_force == pytest.approx(1650.0, rel=1e-3)
    assert contact.peak_displacement == pytest.approx(42e-6, rel=1e-3)


@pytest.mark.parametrize("tool", TOOLS)
def test_a_choice_in_the_rock_is_the_drill_that_runs(tool):
    drill = Rock(20e-6, 0.8, 7.0, 0.0, tool).parameters()

    assert drill.regime == "drilling"
    assert (drill.vibration_amplitude, drill.actuator_restitution) == (20e-6, 0.8)
    assert (drill.weight_on_bit, drill.gravity) == (7.0, 0.0)
    for name, value in TOOLS[tool].changes.items():
        assert getattr(drill, name) == value


def test_there_is_no_weight_on_bit_before_drilling():
    drill = Before(20e-6, 0.8, 0.0, SHAPE_MASS).parameters()

    assert drill.regime == "free"
    assert drill.weight_on_bit == 0.0
    assert (drill.drill_tool_mass, drill.gravity) == (SHAPE_MASS, 0.0)


def test_choices_that_change_nothing_are_the_tables():
    assert Before().parameters() == preset("free")
    assert Rock().parameters() == preset("drilling")


@given(free_mass=MASSES, tool_mass=MASSES)
def test_shares_of_the_energy_add_up(free_mass, tool_mass):
    shares = {name: energy_share(name, free_mass, tool_mass) for name in ENERGIES}
    velocity = free_mass / (free_mass + tool_mass)  # after (21), of a mass that arrives with 1 m/s
    arriving = 0.5 * free_mass

    assert shares["arriving"] == 1.0
    assert shares["common"] * arriving == pytest.approx(0.5 * (free_mass + tool_mass) * velocity**2)
    assert shares["tool"] * arriving == pytest.approx(0.5 * tool_mass * velocity**2)
    # The free mass leaves with the common velocity.
    assert (1.0 - shares["net"]) * arriving == pytest.approx(0.5 * free_mass * velocity**2)
    assert shares["net"] >= shares["tool"]


def test_what_the_free_mass_takes_back_is_what_the_contact_gives_it():
    drill = Rock(tool=IMPLIED, gravity=0.0).parameters()
    contact = single_contact(drill, 5.0)

    net = energy_share("net", drill.free_mass, contact.tool_mass)
    assert net == pytest.approx(1.0 - contact.restitution**2)


def test_a_reading_is_consistent_if_both_regimes_share_amplitude_restitution_and_gravity():
    reading = Reading("", Before(), Rock())

    assert reading.consistent
    for change in ({"vibration_amplitude": 1e-5}, {"actuator_restitution": 0.5}, {"gravity": 0.0}):
        other = dataclasses.replace(reading, rock=dataclasses.replace(reading.rock, **change))
        assert not other.consistent


def test_the_page_on_the_model_shows_the_contact_models_as_they_are():
    page = (Path(__file__).parents[3] / "docs" / "explanation" / "model.md").read_text(
        encoding="utf-8"
    )
    section = page[page.index("## Four contact models") : page.index("## A jammed free mass")]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in section.splitlines()
        if line.startswith("|")
    ]

    for column, model in enumerate(rows[0][1:], 1):
        drill = preset("drilling").replace(contact_model=model.strip("`"))
        contact = single_contact(drill, 5.0)
        cells = {row[0].partition(" at ")[0]: row[column] for row in rows}
        assert f"{1e3 * contact.tool_mass:.3f} g" in cells["m_eff,dt"]
        assert f"{contact.tool_spring_rate:.4g} N/m" in cells["k_eff,dt"]
        assert cells["contact force"] == f"{plain(contact.peak_force)} N"
        assert cells["displacement"] == f"{plain(1e6 * contact.peak_displacement)} um"
        assert cells["contact time"] == f"{1e6 * contact.duration:#.3g} us"
