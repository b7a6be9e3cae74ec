"""Emulators and posteriors, against figures and drills that are known in closed form."""

import dataclasses
import math

import numpy as np
import pytest
from plain_values import parse_targets
from scipy import stats

from rpud_sim.studies.fit.posterior import Emulator, EmulatorError, Likelihood, Region, sample

SPREAD = 0.05
WHOLE = Region.whole(2)
GROUPS = np.zeros(2, int)


def design():
    """Return a design with two figures: a product, and a sum of both unknowns; with chance."""
    shares = WHOLE.points(256, np.random.default_rng(1))
    x, y = shares.T
    means = np.stack([np.exp(1.0 + 0.5 * (x + y)), 3.0 + x + y], axis=-1)
    noise = np.random.default_rng(2).standard_normal((len(shares), 4, 2))
    return shares, means[:, None] * np.exp(SPREAD * noise)


def targets(**entries):
    return parse_targets(
        {
            "unknowns": {"weight_on_bit": [0.0, 10.0], "gravity": [0.0, 10.0]},
            "targets": [
                {"figure": name, "value": value, "tolerance": "5 %"} | entries
                for name, value in (("contact_force_mean", 4.5), ("reacting_force_mean", 4.0))
            ],
        }
    ).targets


@pytest.fixture(scope="module")
def emulator():
    return Emulator(WHOLE, *design(), GROUPS)


def test_an_emulator_gives_the_means_and_knows_chance_and_error(emulator):
    shares = np.random.default_rng(3).random((200, 2))
    x, y = shares.T
    expected = np.stack([1.0 + 0.5 * (x + y), np.log(3.0 + x + y)], axis=-1)
    assert np.sqrt(np.mean((emulator(shares) - expected) ** 2)) < 0.01
    assert np.sqrt(np.diag(emulator.chance)) == pytest.approx([SPREAD] * 2, rel=0.1)
    assert np.sqrt(np.diag(emulator.error)) == pytest.approx([0.0, 0.0], abs=0.015)


def test_an_emulator_is_valid_inside_its_region_and_where_figures_exist():
    shares, figures = design()
    figures[shares[:, 0] < 0.5] = np.nan
    found = Emulator(WHOLE, shares, figures, GROUPS)
    asked = np.array([[0.9, 0.5], [0.1, 0.5], [1.1, 0.5]])
    assert found.supports(asked).tolist() == [True, False, False]
    figures[:] = np.nan
    with pytest.raises(EmulatorError, match="0 of 256 points have all figures"):
        Emulator(WHOLE, shares, figures, GROUPS)


def test_the_posterior_is_that_of_the_closed_form(emulator):
    likelihood = Likelihood(emulator, targets())
    posterior = sample(likelihood, np.random.default_rng(4))
    total = posterior.shares.sum(axis=1)
    grid = (np.stack(np.meshgrid(*[np.linspace(0, 1, 201)] * 2), axis=-1)).reshape(-1, 2)
    sums = grid.sum(axis=1)
    error = math.hypot(SPREAD, 0.05)
    logs = stats.norm.logpdf(math.log(4.5), 1.0 + 0.5 * sums, error)
    logs += stats.norm.logpdf(math.log(4.0), np.log(3.0 + sums), error)
    weights = np.exp(logs) / np.exp(logs).sum()
    mean = weights @ sums
    deviation = math.sqrt(weights @ (sums - mean) ** 2)
    assert total.mean() == pytest.approx(mean, abs=0.3 * deviation)
    assert total.std() == pytest.approx(deviation, rel=0.2)
    assert posterior.log_evidence == pytest.approx(math.log(np.exp(logs).mean()), abs=0.3)
    best = likelihood.best(posterior.shares[0], WHOLE)
    assert likelihood(best[None])[0] >= posterior.log_likelihood.max() - 1e-6


def test_a_target_without_a_logarithm_cannot_be_reached_by_a_positive_figure(emulator):
    seen, other = targets()
    negative = dataclasses.replace(other, value=-4.0)
    found = Likelihood(emulator, (seen, negative))(np.array([[0.5, 0.5]]))
    assert found.tolist() == [-math.inf]
