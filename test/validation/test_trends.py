"""Verdicts on trends, on cases that are known."""

import numpy as np
import pytest

from validation.trends import OUTPUTS, Study, find_trends


def study(*slopes, noise=0.01, seed=0):
    """A study in which each output follows its slope from 1 on, with noise."""
    values = np.linspace(0.0, 1.0, 9)
    random = np.random.default_rng(seed)
    members = {
        output: 1.0 + slope * values[:, None] + noise * random.standard_normal((9, 12))
        for output, slope in zip(OUTPUTS, slopes, strict=True)
    }
    return Study("free_mass", values, members)


def test_a_trend_rises_falls_or_is_flat():
    trends = find_trends([study(0.5, -0.5, 0.0, 0.02)])

    assert [trend.verdict for trend in trends] == ["rises", "falls", "flat", "flat"]
    assert trends[3].p_value < 0.05, "a change of 2 % is significant here, and little"
    assert trends[0].change == pytest.approx(0.5 / 1.25, abs=0.02)
