"""What is reported of an impact on the drill tool."""

from types import SimpleNamespace

import numpy as np
import pytest
from closed_forms import FREE_MASS, motion

from rpud_sim.model.contact import UndisturbedContact
from rpud_sim.model.contact_models import EffectiveTool
from rpud_sim.model.drill import derive
from rpud_sim.model.engine import Engine
from rpud_sim.model.impact import open_impact
from rpud_sim.model.parameters import preset
from rpud_sim.model.segment import CONTACT_BOTH


@pytest.fixture(scope="module")
def drilled():
    engine = Engine(preset("drilling"), 0.4)
    engine.advance(2, 0.0)
    return engine.drain()


def impact_pairs(segments, impacts):
    """Give impacts of one undisturbed segment, with the segment before and their own."""
    starts = segments["start_seconds"] + segments["start_fraction"]
    for impact in impacts:
        (index,) = np.flatnonzero(np.abs(starts - impact["seconds"] - impact["fraction"]) < 1e-13)[
            :1
        ]
        before, contact, after = segments[index - 1 : index + 2]
        alone = before["contact"] == 0 == before["drill_tool_cosine"] == after["contact"]
        if index and contact["contact"] == 2 and alone:
            yield impact, before, contact


def test_undisturbed_impacts_follow_eqs_21_and_36_to_39(drilled):
    drill = derive(preset("drilling"))
    checked = 0
    for impact, before, _ in impact_pairs(drilled[0], drilled[1][5:300]):
        velocity = motion(before, FREE_MASS, before["duration"], 1)
        assert impact["impact_velocity"] == pytest.approx(velocity)
        assert impact["energy"] == pytest.approx(0.5 * drill.free_mass * velocity**2)
        together = drill.free_mass * velocity / (drill.free_mass + drill.tool_mass)
        tool = EffectiveTool(drill.tool_mass, drill.tool_spring_rate)
        alone = UndisturbedContact(0.0, together, drill.free_mass, tool, drill.gravity)
        assert impact["peak_force"] == pytest.approx(alone.greatest_force)
        assert impact["contact_duration"] == pytest.approx(alone.duration, rel=1e-3)
        # What it brought, and what the tool's elasticity gave it back.
        impulse = drill.free_mass * (velocity + together)
        impulse += drill.free_mass * drill.gravity * impact["contact_duration"]
        assert impact["impulse"] == pytest.approx(impulse, rel=1e-3)
        checked += 1
    assert checked > 20


def test_impact_in_progress_counts_from_its_beginning():
    engine = Engine(preset("drilling"), 0.4)
    taken = 0
    for step in range(1, 2000):
        engine.advance(0, step * 1e-5)
        taken += len(engine.drain()[1])
        assert engine.impact_count - taken in (0, 1)


def test_an_impact_in_the_rock_is_squeezed_only_if_a_contact_of_all_three_lasts():
    state = SimpleNamespace(impacts=0, seconds=0, fraction=0.0, contact=CONTACT_BOTH)
    collisions = SimpleNamespace(impact_velocity=1.0, energy=1.0, impulse=1.0, energy_transferred=1)
    impact = SimpleNamespace()
    open_impact.py_func(derive(preset("drilling")), state, impact, collisions)
    assert state.impact_open
    assert not impact.squeezed
