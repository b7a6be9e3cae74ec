"""Designs: their points lie where each kind promises."""

import itertools
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.studies.sweep.chunks import design_points
from rpud_sim.studies.sweep.specification_file import parse_specification

SWEPT = {
    "weight_on_bit": {"minimum": 0.0, "maximum": 32.0},
    "free_mass": {"minimum": 1e-3, "maximum": 1e-2, "scale": "log"},
    "contact_model": ["printed", "rayleigh"],
}


def points(design, number, seed=0):
    return design_points(
        parse_specification(
            {"design": design, "points": number, "seed": seed, "duration": 1, "swept": SWEPT}
        )
    )


def test_a_grid_has_every_combination_once():
    found = design_points(
        parse_specification(
            {
                "design": "grid",
                "duration": 1,
                "swept": {
                    "weight_on_bit": {"minimum": 0, "maximum": 40, "points": 3},
                    "regime": ["free", "drilling"],
                    "gravity": [9.81, 1.62],
                },
            }
        )
    )
    expected = itertools.product([0.0, 20.0, 40.0], ["free", "drilling"], [9.81, 1.62])
    assert list(zip(*(column.tolist() for column in found.values()), strict=True)) == list(expected)


@given(exponent=st.integers(1, 8), seed=st.integers(0, 2**32), latin=st.booleans())
def test_every_stratum_of_every_parameter_has_one_point(exponent, seed, latin):
    number = 2**exponent
    found = points("latin_hypercube" if latin else "sobol", number, seed)
    shares = {
        "weight_on_bit": found["weight_on_bit"] / 32.0,
        "free_mass": np.log10(found["free_mass"] / 1e-3),
    }
    for name, share in shares.items():
        strata = np.floor(share * number + 1e-9).astype(int)
        assert sorted(strata) == list(range(number)), name
    assert Counter(found["contact_model"].tolist()) == {
        "printed": number // 2,
        "rayleigh": number // 2,
    }


@pytest.mark.parametrize("design", ["latin_hypercube", "sobol"])
def test_a_design_is_that_of_its_seed(design):
    one, same, other = (points(design, 32, seed) for seed in (1, 1, 2))
    for name in SWEPT:
        assert one[name].tolist() == same[name].tolist()
    assert one["weight_on_bit"].tolist() != other["weight_on_bit"].tolist()
