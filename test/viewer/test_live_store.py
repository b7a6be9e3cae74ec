"""Layers of a view, near and far."""

import numpy as np
import pytest
from viewer.test_heard import ORIGIN, PARAMETERS, SECOND, entry, status

from rpud_sim.viewer.heard import Heard

RATE, SECONDS = 1000, 100


@pytest.fixture(scope="module")
def heard():
    """100 s, of which 1000 impacts a second from 10 s on; peaks from 0 to 999 N."""
    heard = Heard()
    heard.latched("journal", entry(0, "begin", 0, parameters=PARAMETERS))
    add = heard.sinks()["contact_force"]
    for number in range(10 * RATE, SECONDS * RATE):
        stamp = ORIGIN + number * SECOND // RATE
        add(stamp, (number, float(number % RATE), 1e-5, 2.0, 0.01, 1.0, 0.5, False))
    heard.settle()
    return heard


def layer_of(heard, quantity, kind, start, end, parts):
    view = heard.picture(start).view(start, end, 2 * parts, {quantity: kind})
    return view["layers"][quantity]


@pytest.mark.parametrize("start", [0.0, 50.0, 95.0])
def test_the_rate_of_impacts_is_that_of_those_that_were_heard(heard, start):
    layer = layer_of(heard, "impact_rate", "line", start, 100.0, 100)
    assert layer["t"][0] >= max(start, 10.0) - 1.0
    np.testing.assert_allclose(layer["mean"][1:-1], RATE, rtol=0.05)  # one may be on an edge


def test_near_the_band_has_most_impacts_and_far_all_of_them(heard):
    near = layer_of(heard, "peak_force", "band", 95.0, 100.0, 3)
    assert near["band"] == "5-95 %"
    assert near["low"][1] > 20.0
    far = layer_of(heard, "peak_force", "band", 0.0, 100.0, 100)
    assert far["band"] == "least-greatest"
    assert far["low"][1] == 0.0
    assert far["high"][1] == 999.0
    assert far["t"][0] == pytest.approx(10.0, abs=1.0)


def test_parts_of_the_peak_force_are_as_long_where_little_was_heard(heard):
    layers = heard.picture().view(-9990.0, 10.1, 10_000, {"peak_force": "band"})["layers"]
    assert len(layers["peak_force"]["t"]) <= 4


def test_a_number_that_a_status_says_is_that_of_the_latest_one():
    heard = Heard()
    heard.latched("journal", entry(0, "begin", 0, parameters=PARAMETERS))
    lacks = {"electrical_power": np.nan}
    for second, power in ((1, 400.0), (2, 16.0)):
        heard.latched("status", status(second * SECOND, actuator_power=power, **lacks))
    power = heard.picture().numbers(2.3)["power"]
    assert [power[name] for name in ("mean", "least", "greatest")] == [16.0] * 3
