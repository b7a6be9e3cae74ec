"""The flow of power: what flows in flows out again, and the account closes."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.viewer.report import FEED_POWERS, INFLOWS, MOUNT, OUTFLOWS, energy_table, terms

powers = st.lists(st.floats(-100.0, 100.0), min_size=6, max_size=6)


def balanced(values):
    """Give powers by name; the last one closes the balance."""
    names = [*INFLOWS, *OUTFLOWS]
    given_powers = dict(zip(names, values, strict=False))
    inflow = sum(given_powers[name] for name in INFLOWS)
    outflow = sum(given_powers.get(name, 0.0) for name in OUTFLOWS)
    return {**given_powers, names[-1]: inflow - outflow}


@given(powers)
def test_what_flows_in_flows_out(values):
    into, out = terms(balanced(values))
    assert sum(into.values()) == pytest.approx(sum(out.values()), abs=1e-9)


@given(powers)
def test_the_account_closes(values):
    table = energy_table(balanced(values), 2.0)
    [residual] = [row for row in table["rows"] if row[0].startswith("residual")]
    assert float(residual[1]) == pytest.approx(0.0, abs=1e-9)


def test_with_a_feed_its_work_takes_the_place_of_the_weight_on_bit():
    found = balanced([5.0, 3.0, 0.0, 4.0, 1.0, 1.0])
    feed = dict(zip(FEED_POWERS, (2.0, 2.5, 0.5), strict=True))
    into, out = terms(found | feed)
    assert out[MOUNT] == 0.5
    assert sum(into.values()) == pytest.approx(sum(out.values()))


def test_powers_that_are_not_known_make_no_account():
    assert energy_table(balanced([1.0] * 6) | {"absorbed_power": math.nan}, 2.0) is None
