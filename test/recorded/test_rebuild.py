"""Waveforms out of a bag's trajectory: those that the drill published, and any other rate."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from altered_bags import altered
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_bags import write_offline_bag
from support import examples, extended

import rpud_sim.bag
from rpud_sim.bag import BagWriter
from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.rebuild import RecordedSegments, _Waveform, rebuild
from rpud_sim.simulation import preset
from rpud_sim.simulation.sampling import CHANNELS, Times, end_sample
from rpud_sim.simulation.simulation import Simulation

DURATION = 0.4


@pytest.fixture(scope="module", params=["free", "drilling"])
def regime(request):
    return request.param


@pytest.fixture(scope="module")
def bag(tmp_path_factory, regime):
    path = tmp_path_factory.mktemp("rebuild") / "bag"
    write_offline_bag(path, preset(regime), DURATION)
    return path


def load(folder):
    table = pd.read_parquet(folder / "rpud.trajectory.parquet")
    return {channel: table[channel].to_numpy() for channel in CHANNELS}


def only_trajectory(source, out, keep=lambda number: True):
    """Write a bag of the trajectory alone, of those messages whose number is to be kept."""
    numbers = itertools.count()
    return altered(
        source, out, lambda m: [m.data] if keep(next(numbers)) else [], {"/rpud/trajectory"}
    )


@pytest.mark.extended
def test_at_the_published_rate_it_is_the_published_waveform_bit_for_bit(bag, tmp_path):
    rebuilt = rebuild(only_trajectory(bag, tmp_path / "bag"), tmp_path / "out", 50_000)
    found = load(tmp_path / "out")
    with rpud_sim.bag.open(bag) as opened:
        published = opened.arrays("/rpud/waveform")
    assert (rebuilt.first, rebuilt.missing, rebuilt.origin) == (0, 0, 0)
    # The last segment was still open when the recording ended.
    assert 0.9 * DURATION * 50_000 < rebuilt.count <= DURATION * 50_000
    both = found.keys() & published.keys()
    assert len(both) == 6
    for channel in both:
        values = published[channel]
        assert found[channel].tobytes() == values[: rebuilt.count].tobytes(), channel


@pytest.mark.extended
def test_each_sample_has_its_stamp_and_the_account_stands_beside_them(bag, tmp_path):
    rebuilt = rebuild(bag, tmp_path / "out", 30_000, start=0.1)
    table = tmp_path / "out" / "rpud.trajectory.parquet"
    found = pd.read_parquet(table)["time"].astype("int64").to_numpy()
    numbers = range(rebuilt.first, rebuilt.first + rebuilt.count)
    assert found.tolist() == [rebuilt.origin + round(n * 1e9 / 30_000) for n in numbers]
    account = json.loads((tmp_path / "out" / "export.json").read_text())
    assert account.items() >= vars(rebuilt).items()
    assert account["columns"]["free_mass_velocity"]["unit"] == "m/s"
    assert rebuilt.size == table.stat().st_size


@pytest.mark.parametrize("lost", [(2, 3), (0, 1, 2, 3)], ids=["a gap", "a late begin"])
@pytest.mark.extended
def test_where_segments_are_missing_it_is_not_a_number(bag, tmp_path, lost):
    source = only_trajectory(bag, tmp_path / "bag", lambda number: number not in lost)
    rebuilt = rebuild(source, tmp_path / "out", 10_000)
    whole = rebuild(bag, tmp_path / "whole", 10_000)
    found, expected = load(tmp_path / "out"), load(tmp_path / "whole")
    gap = np.isnan(found["reacting_force"])
    assert rebuilt.count == whole.count - rebuilt.first
    assert rebuilt.missing == gap.sum()
    assert rebuilt.first + rebuilt.missing == pytest.approx(500 * len(lost), abs=200)
    assert (rebuilt.first > 0) == (rebuilt.missing == 0)
    for channel in CHANNELS:
        assert (np.isnan(found[channel]) == gap).all()
        kept = expected[channel][rebuilt.first :][~gap]
        assert found[channel][~gap].tobytes() == kept.tobytes(), channel


@pytest.mark.parametrize(
    ("topic", "options", "reason"),
    [
        ("waveform", {}, "holds no trajectory"),
        extended("trajectory", {"start": 9.0}, r"start = 9 s is not in the 0\.[34]\d* s that"),
        ("trajectory", {"run": 2}, "there is no run 2"),
    ],
)
def test_what_the_bag_lacks_is_refused(bag, tmp_path, topic, options, reason):
    altered(bag, tmp_path / "bag", lambda m: [m.data], {f"/rpud/{topic}"})
    with pytest.raises(RecordingError, match=reason):
        rebuild(tmp_path / "bag", tmp_path / "out", 1000, **options)
    assert not (tmp_path / "out").exists()


def test_a_trajectory_of_no_drill_is_refused_as_what_the_bag_lacks(bag, tmp_path):
    """Nobody has given a namespace, so none is called wrong."""
    with rpud_sim.bag.open(bag) as source, BagWriter(tmp_path / "bag") as copy:
        [summary] = [each for each in source.topics if each.topic.name == "/rpud/trajectory"]
        copy.add_topic(replace(summary.topic, name="/planned"), summary.definition)
        for each in source.messages({"/rpud/trajectory"}):
            copy.write("/planned", each.data, each.log_time, each.publish_time)
    with pytest.raises(RecordingError, match=r"/planned is the trajectory of no drill") as raised:
        rebuild(tmp_path / "bag", tmp_path / "out", 1000)
    assert raised.value.code == 1


@pytest.mark.extended
def test_a_run_of_several_is_chosen(used, tmp_path):
    """Messages are missing, and the first run has a second origin."""
    first, second = (rebuild(used.path, tmp_path / f"{n}", 1000, run=n) for n in (1, 2))
    assert (first.runs, second.runs) == (2, 2)
    assert first.trajectory_size > second.trajectory_size > 0
    assert 140 < first.first + first.count < 180
    assert 50 < second.first + second.count < 80
    assert second.origin == first.origin + SECOND


@settings(max_examples=examples(20))
@given(
    rate=st.sampled_from([1, 999, 16_000, 50_000, 1_234_567]),
    cuts=st.lists(st.integers(0, 10_000), max_size=5),
)
def test_however_it_is_cut_the_samples_are_those_of_the_whole(rate, cuts):
    simulation = Simulation(preset("drilling"))
    simulation.advance_to(SECOND // 10)
    block = simulation.advance_to(SECOND // 5)
    segments = block.segments
    parts = np.split(segments, sorted({cut % len(segments) for cut in cuts}))
    messages = [RecordedSegments(part, n > 0, 0, 0, 0) for n, part in enumerate(parts) if len(part)]
    try:
        found = [*_Waveform(rate, 0.0, None).rows(messages)]
    except RecordingError:  # no sample lies in it
        found = []
    # The block begins within a segment: its own samples begin there.
    first, end = block.grid(rate).start, end_sample(segments[-1], rate)
    expected = block.sample(Times.from_grid(first, max(0, end - first), rate))
    start = found[0][0] if found else first
    for number, count, values in found:  # without a gap
        assert (number, values is None) == (start, False)
        start += count
    for name in CHANNELS if found else ():
        made = np.concatenate([values[name] for _, _, values in found])
        assert made[first - found[0][0] :].tobytes() == getattr(expected, name).tobytes()
    assert found or not len(expected.in_contact)


@pytest.mark.extended
def test_without_a_journal_a_trajectory_that_begins_again_is_refused(used, tmp_path):
    path = only_trajectory(used.path, tmp_path / "bag")
    with pytest.raises(RecordingError, match=r"begins again at .* no journal shows"):
        rebuild(path, tmp_path / "out", 1000)
    assert not (tmp_path / "out").exists()
