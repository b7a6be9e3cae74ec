"""Depth is the energy of the impacts over what the rock takes, however they are handed over."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.rock import PercussionDepth, RockParameters
from rpud_sim.model.segment import IMPACT

SANDSTONE = RockParameters(rock_model="specific_energy")
PER_JOULE = 0.01 / (75e6 * 2.0e-5)  # depth [m/J]
SECOND = 1_000_000_000


def impacts(energies, spacing=0.002):
    """Records of impacts with these energies, evenly spaced in time."""
    records = np.zeros(len(energies), IMPACT)
    records["fraction"], records["seconds"] = np.modf(spacing * np.arange(len(energies)))
    records["energy_transferred"] = energies
    return records


def after(energies, rock=SANDSTONE, length=0.09, **factors):
    progress = PercussionDepth(rock, length)
    progress.add(impacts(energies), **factors)
    return progress


def test_the_volume_is_the_energy_that_breaks_over_the_specific_energy():
    rock = RockParameters("specific_energy", 50e6, 0.5, 1e-4)
    # 50 J break 1 cm^3 of this rock.
    assert after([0.25] * 400, rock).depth * 1e-4 == pytest.approx(1e-6, rel=1e-12)


def test_without_a_rock_model_there_is_no_depth():
    off = after([1.0], RockParameters())
    assert math.isnan(off.depth)
    assert math.isnan(off.penetration_rate(SECOND))


@given(
    st.lists(st.floats(0.0, 10.0), max_size=200),
    st.lists(st.integers(0, 200), max_size=10),
    st.floats(0.001, 0.1),
)
def test_it_does_not_matter_how_impacts_are_split_into_blocks(energies, cuts, spacing):
    records = impacts(energies, spacing)
    whole, parts = PercussionDepth(SANDSTONE, 0.09), PercussionDepth(SANDSTONE, 0.09)
    whole.add(records)
    for part in np.split(records, sorted(cuts)):
        parts.add(part)
    assert parts.depth == whole.depth
    end = int(len(records) * spacing * SECOND) + 1
    assert parts.penetration_rate(end) == whole.penetration_rate(end)


@pytest.mark.parametrize(
    ("factors", "joules"), [({}, 0.55), ({"hardness": 4.0}, 0.1375), ({"clearing": 0.3}, 0.165)]
)
def test_hard_rock_and_choking_slow_it_and_energy_taken_back_fills_nothing(factors, joules):
    depth = after([0.3, -0.1, 0.05, 0.2], **factors).depth
    assert depth == pytest.approx(joules * PER_JOULE, rel=1e-12)


def test_the_hole_is_at_most_as_deep_as_the_tool_is_long():
    progress = after([0.1] * 1600, length=1e-6)
    assert (progress.depth, progress.penetration_rate(4 * SECOND)) == (1e-6, 0.0)


def test_the_rate_is_the_mean_over_the_last_second_or_so_far():
    # 2 s at 0.2 J, then 0.4 J, 500 times a second.
    progress = after([0.2] * 1000 + [0.4] * 500)
    for time, power in ((3.0, 200.0), (3.5, 100.0), (5.0, 0.0)):
        rate = progress.penetration_rate(int(time * SECOND) - 1)
        assert rate == pytest.approx(power * PER_JOULE, rel=1e-12)
    early = after([0.2] * 100)
    assert early.penetration_rate(0) == 0.0
    assert early.penetration_rate(SECOND // 5) == pytest.approx(100.0 * PER_JOULE, rel=1e-12)
