"""The flow of power: what flows in flows out again, and every band has its power."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.inspection.report.drill_topics import Powers
from rpud_sim.inspection.report.power_flow import INFLOWS, OUTFLOWS, flows, power_flow

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


def test_bands_are_as_wide_as_their_powers_and_labels_have_them():
    values = dict.fromkeys((*INFLOWS, *OUTFLOWS), 0.0)
    powers = {**values, "actuator_power": 8.0, "absorbed_power": 6.0, "load_damper_power": 2.0}
    axis = power_flow(powers).axes[0]
    texts = [text.get_text() for text in axis.texts]
    assert "8 W" in texts
    assert f"{OUTFLOWS['absorbed_power']}\n6 W" in texts
    assert len(axis.collections) == 3
    widths = []
    for band in axis.collections:
        corners = band.get_paths()[0].vertices
        inner = corners[np.isclose(abs(corners[:, 0] - 0.5), 0.03)]
        widths.append(np.ptp(inner[:, 1]))
    assert widths == pytest.approx([1.0, 0.75, 0.25], rel=1e-6)


def test_a_drill_at_rest_has_a_picture_without_bands():
    assert not power_flow(dict.fromkeys((*INFLOWS, *OUTFLOWS), 0.0)).axes[0].collections


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
