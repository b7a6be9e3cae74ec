"""Depth is the energy of the impacts over what the rock takes, however they are handed over."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.rock import Progress, RockParameters
from rpud_sim.model.segment import IMPACT

SANDSTONE = RockParameters(rock_model="specific_energy")
SECOND = 1_000_000_000
LENGTH = 0.09  # of the drill tool [m]


def impacts(energies, spacing=0.002):
    """Records of impacts with these energies, evenly spaced in time."""
    records = np.zeros(len(energies), IMPACT)
    times = spacing * np.arange(len(energies))
    records["seconds"] = times.astype(int)
    records["fraction"] = times % 1.0
    records["energy_transferred"] = energies
    return records


def depth(records, **factors):
    progress = Progress(SANDSTONE, LENGTH)
    progress.add(records, **factors)
    return progress.depth


def test_the_volume_is_the_energy_that_breaks_over_the_specific_energy():
    rock = RockParameters("specific_energy", 50e6, 0.5, 1e-4)
    progress = Progress(rock, LENGTH)
    progress.add(impacts([0.25] * 400))
    # 50 J break 1 cm^3 of this rock.
    assert progress.depth * rock.hole_area == pytest.approx(1e-6, rel=1e-12)


def test_the_default_is_the_sandstone_of_section_v_but_switched_off():
    assert RockParameters(rock_model="specific_energy") == SANDSTONE
    off = Progress(RockParameters(), LENGTH)
    off.add(impacts([1.0]))
    assert math.isnan(off.depth)
    assert math.isnan(off.penetration_rate(SECOND))


@given(
    st.lists(st.floats(0.0, 10.0), max_size=200),
    st.lists(st.integers(0, 200), max_size=10),
    st.floats(0.001, 0.1),
)
def test_it_does_not_matter_how_impacts_are_split_into_blocks(energies, cuts, spacing):
    records = impacts(energies, spacing)
    whole, parts = Progress(SANDSTONE, LENGTH), Progress(SANDSTONE, LENGTH)
    whole.add(records)
    for part in np.split(records, sorted(cuts)):
        parts.add(part)
    assert parts.depth == whole.depth
    end = int(len(records) * spacing * SECOND) + 1
    assert parts.penetration_rate(end) == whole.penetration_rate(end)


def test_hard_rock_and_choking_slow_the_progress_by_their_factors():
    records = impacts(np.linspace(0.1, 0.3, 50))
    assert depth(records, hardness=4.0) == pytest.approx(depth(records) / 4.0, rel=1e-12)
    assert depth(records, clearing=0.3) == pytest.approx(depth(records) * 0.3, rel=1e-12)
    assert depth(records, clearing=0.0) == 0.0
    assert depth(records) > 0.0


def test_a_free_mass_that_takes_energy_back_does_not_fill_the_hole():
    progress = Progress(SANDSTONE, LENGTH)
    depths = []
    for energy in (0.3, -0.1, 0.05, 0.2):
        progress.add(impacts([energy]))
        depths.append(progress.depth)
    assert depths == pytest.approx([depth(impacts([e])) for e in (0.3, 0.3, 0.35, 0.55)])


def test_the_hole_is_at_most_as_deep_as_the_tool_is_long():
    progress = Progress(SANDSTONE, 1e-6)
    progress.add(impacts([0.1] * 1600))
    assert (progress.depth, progress.penetration_rate(4 * SECOND)) == (1e-6, 0.0)


def test_the_rate_is_the_mean_over_the_last_second():
    progress = Progress(SANDSTONE, LENGTH)
    assert progress.penetration_rate(0) == 0.0
    # 2 s at 0.2 J, then 0.4 J, 500 times a second.
    progress.add(impacts([0.2] * 1000 + [0.4] * 500))
    per_joule = 0.01 / (75e6 * 2.0e-5)
    assert progress.penetration_rate(3 * SECOND - 1) == pytest.approx(200.0 * per_joule, rel=1e-12)
    # Half a second without impacts halves it, one ends it.
    assert progress.penetration_rate(3 * SECOND + SECOND // 2 - 1) == pytest.approx(
        100.0 * per_joule, rel=1e-12
    )
    assert progress.penetration_rate(5 * SECOND) == 0.0


def test_in_the_first_second_the_rate_is_the_mean_so_far():
    progress = Progress(SANDSTONE, LENGTH)
    progress.add(impacts([0.2] * 100))
    assert progress.penetration_rate(SECOND // 5) == pytest.approx(progress.depth / 0.2, rel=1e-12)
