"""Plan of a data set: a rock is in one split, and a run's draws depend on nothing but the run."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from sample_datasets import CONTENT, parsed

from rpud_sim.studies.dataset.plan import plan_runs

SECOND = 1_000_000_000


def by_name(specification):
    return {run.name: run for run in plan_runs(specification)}


@given(seed=st.integers(0, 2**32 - 1), seeds=st.integers(0, 3), healthy=st.integers(1, 3))
def test_each_run_is_planned_once_and_inside_its_intervals(seed, seeds, healthy):
    specification = parsed(
        seed=seed, seeds=seeds, healthy=healthy, varied={"gravity": {"minimum": 1, "maximum": 9}}
    )
    runs = plan_runs(specification)
    assert len({run.name for run in runs}) == len(runs) == specification.run_count
    assert [run.number for run in runs] == list(range(len(runs)))
    for run in runs:
        assert run.split == specification.rocks[run.rock].split
        assert 0 <= run.seed < 2**32
        assert 0.0 <= run.initial_phase < 1.0
        assert 1.0 <= run.values["gravity"] <= 9.0
        if run.fault:
            assert 1.0 * SECOND <= run.onset <= 2.0 * SECOND
            assert 0.5 * SECOND <= run.clear - run.onset <= 1.0 * SECOND
        else:
            assert (run.severity, run.onset, run.clear) == (0, None, None)


def test_another_rock_fault_or_parameter_changes_no_other_draw():
    before = by_name(parsed())
    after = by_name(
        parsed(
            rocks={"flint": {"split": "train", "gravity": 1.0}, **CONTENT["rocks"]},
            faults=[{"kind": "lost_preload"}, *CONTENT["faults"]],
            varied={"weight_on_bit": {"minimum": 5, "maximum": 9}},
            seeds=2,
        )
    )
    for name, run in before.items():
        other = after[name]
        assert (run.onset, run.clear, run.seed) == (other.onset, other.clear, other.seed)
        assert run.initial_phase == other.initial_phase


def test_another_seed_draws_other_numbers():
    one, two = (by_name(parsed(seed=seed)) for seed in (1, 2))
    assert one.keys() == two.keys()
    assert all(one[name].seed != two[name].seed for name in one)


def test_a_fault_without_an_end_lasts_to_the_end_of_the_run():
    runs = plan_runs(parsed(lasting=None))
    assert all(run.clear is None for run in runs)
    run = next(run for run in runs if run.fault)
    around = np.array([run.onset - 1, run.onset, 4 * SECOND])
    assert run.lasts_at(around).tolist() == [False, True, True]


def test_a_fault_lasts_from_its_onset_on_and_before_its_end():
    run = next(run for run in plan_runs(parsed()) if run.fault)
    around = np.array([run.onset - 1, run.onset, run.clear - 1, run.clear])
    assert run.lasts_at(around).tolist() == [False, True, True, False]
    assert run.magnitude == 0.2
    assert (run.kind, run.channel, run.severity) == ("choking", "", 1)
