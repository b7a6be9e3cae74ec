"""Lines lose no peak and cross no gap; the hole has its layers and its log."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from rpud_sim.drilling.rock import ROCKS, Strata, preset_layer
from rpud_sim.viewer.bins import thinned, with_gaps
from rpud_sim.viewer.borehole import rock_layers as layers
from rpud_sim.viewer.borehole import well_log

VALUES = arrays.arrays(float, st.integers(0, 300), elements=st.floats(-1e9, 1e9))


@given(VALUES, st.integers(2, 50))
def test_thinning_keeps_both_ends_and_every_extreme_and_invents_nothing(values, most):
    times = np.arange(len(values), dtype=float)
    line = thinned(times, values, most)
    assert len(line["t"]) <= max(most + 2, 4)
    assert (values[line["t"].astype(int)] == line["mean"]).all()
    assert (np.diff(line["t"]) > 0.0).all()
    if len(values):
        assert (line["mean"].min(), line["mean"].max()) == (values.min(), values.max())
        assert (line["t"][0], line["t"][-1]) == (times[0], times[-1])


def test_a_line_ends_at_a_gap():
    layer = with_gaps({"t": np.array([0.0, 1.0, 2.0, 9.0, 10.0]), "mean": np.arange(5.0)})
    assert np.isnan(layer["mean"]).tolist() == [False, False, False, True, False, False]
    assert 2.0 < layer["t"][3] < 9.0


def test_an_empty_bin_now_and_then_does_not_break_a_line():
    means = np.array([1.0, 1.0, np.nan, 1.0, 1.0, 1.0])
    layer = with_gaps({"t": np.arange(6.0), "mean": means})
    assert np.isfinite(layer["mean"]).all()


FIRST, SECOND = [*ROCKS][:2]


def test_layers_are_those_of_the_strata():
    strata = Strata((preset_layer(FIRST), preset_layer(SECOND, 0.01), preset_layer(FIRST, 0.03)))
    found = layers({"strata": strata.to_text()})
    assert [(each["from"], each["to"], each["name"]) for each in found] == [
        (0.0, 0.01, FIRST), (0.01, 0.03, SECOND), (0.03, None, FIRST),
    ]  # fmt: skip
    assert [each["colour"] for each in found] == [0, 1, 0]


def test_a_recorded_path_is_never_read(tmp_path):
    path = tmp_path / "strata.yaml"
    path.write_text(Strata((preset_layer(FIRST),)).to_text(), encoding="utf-8")
    assert layers({"strata": str(path)}) == layers({"strata": "{broken"}) == []


def test_a_rock_model_without_strata_is_one_layer():
    assert layers({"rock_model": "none"}) == []
    (rock,) = layers({"rock_model": "energy"})
    assert (rock["from"], rock["to"]) == (0.0, None)


def test_the_log_has_means_over_equal_parts_of_the_depth():
    depth = np.linspace(0.0, 0.02, 4000)
    log = well_log(depth, 2.0 * depth, np.ones(4000))
    assert len(log["depth"]) == 200
    assert log["rate"] == pytest.approx(2.0 * log["depth"], abs=2e-4)
    assert (log["torque"] == 1.0).all()
    empty = well_log(np.full(3, np.nan), np.ones(3), None)
    assert [len(values) for values in empty.values()] == [0, 0, 0]
