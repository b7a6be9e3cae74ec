"""Sobol indices: those of functions whose indices are known, also under noise."""

import numpy as np
import pytest

from rpud_sim.studies.sensitivity.sobol_study import design, find_indices

# Ishigami's function: first and total indices in closed form.
ISHIGAMI = ((0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437))


def ishigami(shares):
    x = np.pi * (2.0 * shares - 1.0)
    return np.sin(x[..., 0]) + 7 * np.sin(x[..., 1]) ** 2 + 0.1 * x[..., 2] ** 4 * np.sin(x[..., 0])


def test_each_matrix_differs_from_the_first_in_one_column():
    a, b, *mixed = design(3, 8, 0)
    for column, matrix in enumerate(mixed):
        others = [i for i in range(3) if i != column]
        assert np.array_equal(matrix[:, column], b[:, column])
        assert np.array_equal(matrix[:, others], a[:, others])


def test_the_indices_of_ishigamis_function_are_the_known_ones():
    found = find_indices(ishigami(design(3, 4096, 1))[..., np.newaxis], 1)
    assert found.first[0] == pytest.approx(ISHIGAMI[0], abs=0.02)
    assert found.total[0] == pytest.approx(ISHIGAMI[1], abs=0.02)


def test_the_intervals_hold_the_known_indices():
    found = find_indices(ishigami(design(3, 512, 2))[..., np.newaxis], 2)
    for interval, known in zip((found.first_interval, found.total_interval), ISHIGAMI, strict=True):
        low, high = interval[:, 0]
        assert np.all(low <= np.array(known) + 0.03)
        assert np.all(high >= np.array(known) - 0.03)


def test_noise_adds_its_share_to_every_total_index_and_to_no_first_one():
    shares = design(3, 4096, 3)  # the last input is the phase of a chaotic motion
    noise = np.random.default_rng(3).normal(0.0, np.sqrt(0.25 / 12.0), shares.shape[:2])
    found = find_indices((shares[..., 0] + noise)[..., np.newaxis], 3)
    assert found.first[0] == pytest.approx([0.8, 0.0, 0.0], abs=0.04)
    assert found.total[0] == pytest.approx([1.0, 0.2, 0.2], abs=0.04)


def test_the_same_seed_gives_the_same_bits():
    values = ishigami(design(3, 64, 4))[..., np.newaxis]
    once, again = (find_indices(values, 4) for _ in range(2))
    assert once.total_interval.tobytes() == again.total_interval.tobytes()
