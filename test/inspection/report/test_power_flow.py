"""The flow of power: what flows in flows out again, and the account closes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.inspection.report.account_rows import account_rows
from rpud_sim.inspection.report.drill_topics import Powers
from rpud_sim.inspection.report.power_flow import FEED_POWERS, INFLOWS, MOUNT, OUTFLOWS, flows

powers = st.lists(st.floats(-100.0, 100.0), min_size=6, max_size=6)


def balanced(values):
    """Give powers by name; the last one closes the balance."""
    names = [*INFLOWS, *OUTFLOWS]
    given_powers = dict(zip(names, values, strict=False))
    inflow = sum(given_powers[name] for name in INFLOWS)
    outflow = sum(given_powers.get(name, 0.0) for name in OUTFLOWS)
    return {**given_powers, names[-1]: inflow - outflow}


def reported(values, stamps=(0, 2)):
    """Give the account of a drill that reports these powers at these times [s]."""
    found = Powers([*values])
    columns = {name: np.full(len(stamps), value) for name, value in values.items()}
    columns["header.stamp"] = np.array(stamps) * 1_000_000_000
    found.add(columns, np.array(stamps, float))
    return found


@given(powers)
def test_what_flows_in_flows_out(values):
    into, out = flows(balanced(values))
    assert sum(into.values()) == pytest.approx(sum(out.values()), abs=1e-9)
    assert all(power > 0.0 for power in (*into.values(), *out.values()))
    assert not into.keys() & out.keys()


def test_a_source_that_takes_power_is_on_the_other_side():
    values = dict.fromkeys((*INFLOWS, *OUTFLOWS), 0.0)
    into, out = flows(
        {**values, "actuator_power": 5.0, "weight_power": -1.0, "absorbed_power": 4.0}
    )
    assert into == {INFLOWS["actuator_power"]: 5.0}
    assert out == {INFLOWS["weight_power"]: 1.0, OUTFLOWS["absorbed_power"]: 4.0}


def test_each_report_counts_for_the_time_since_the_last_one():
    """A report before the start has no power; one at the end repeats the last one."""
    powers = Powers(["actuator_power"])
    assert powers.means() == {}
    for stamps, values in (([0, 1, 2], [0.0, 50.0, 60.0]), ([2, 3], [60.0, 70.0])):
        columns = {
            "header.stamp": np.array(stamps) * 1_000_000_000,
            "actuator_power": np.array(values),
        }
        powers.add(columns, np.array(stamps, float))
    assert powers.means() == pytest.approx({"actuator_power": 60.0})
    assert powers.seconds == 3.0


@given(powers)
def test_the_account_closes_to_its_residual(values):
    table = {text: row for text, *row in account_rows(reported(balanced(values)), float("nan"))}
    came, went = (float(table[f"{side}, together"][1]) for side in ("in", "out"))
    assert came == pytest.approx(went, rel=1e-3, abs=1e-6)
    assert abs(float(table["residual: in − out"][1])) < 1e-9
    assert "electrical, drawn by the actuator" not in table


def test_the_account_has_joules_watts_and_shares():
    values = dict.fromkeys((*INFLOWS, *OUTFLOWS), 0.0)
    account = reported({**values, "actuator_power": 8.0, "absorbed_power": 6.0}, (0, 1, 2, 3))
    table = {text: row for text, *row in account_rows(account, 20.0)}
    assert table["in: work of the vibration"] == ["24", "8", "100"]
    assert table["out: drill tool and rock"] == ["18", "6", "75"]
    assert table["residual: in − out"] == ["6", "2", "25"]
    assert table["electrical, drawn by the actuator"] == ["60", "20", "250"]
    assert account_rows(Powers([*values]), 20.0) == []


def test_with_a_feed_its_work_flows_in_and_earlier_reports_have_none():
    values = dict.fromkeys((*INFLOWS, *OUTFLOWS), 0.0)
    values |= {"actuator_power": 8.0, "weight_power": 0.5, "absorbed_power": 8.5}
    fed = {"weight_on_bit_power": 0.3, "feed_power": 1.0, "mount_power": 0.7}
    columns = {name: np.full(3, value) for name, value in {**values, **fed}.items()}
    columns["header.stamp"] = np.arange(3) * 1_000_000_000
    powers = Powers([*values], FEED_POWERS)
    powers.add(columns, np.arange(3.0))
    table = {text: row for text, *row in account_rows(powers, float("nan"))}
    assert float(table["in: feed"][1]) == 1.0
    assert float(table["in: gravity"][1]) == pytest.approx(0.2)
    assert float(table[f"out: {MOUNT}"][1]) == pytest.approx(0.7)
    assert float(table["residual: in − out"][1]) == pytest.approx(0.0, abs=1e-12)
    assert "in: weight on bit and gravity" not in table
    # A drill without a feed, and a message of an earlier version.
    for without in (
        {**columns, "feed_power": np.full(3, np.nan)},
        {name: column for name, column in columns.items() if name != "feed_power"},
    ):
        powers = Powers([*values], FEED_POWERS)
        powers.add(without, np.arange(3.0))
        assert powers.means() == pytest.approx(values)
