"""Bags of drills on a feed are proved, and forked in the middle of a motion."""

import pytest
from inspection.forked_runs import held
from rpud_sim.recorded.verify.verification import verify
from rpud_sim.simulation.plans import Changes, Planned, apply_change, parameter_changes

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.recorded.offline_bag import write_fork, write_offline_bag
from rpud_sim.simulation import Feed
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.ensemble import run_ensemble
from rpud_sim.simulation.run import Beginning, Run

MILLISECOND = 1_000_000
VALUES = {"feed_model": "arm", "initial_feed": 5e-4, "rock_model": "specific_energy"}
PLANNED = (
    Planned(0, Feed("rate", 3e-3)),
    Planned(123_456_789, Feed("position", 2e-3)),
    Planned(250 * MILLISECOND, Feed("rate", -2e-3)),
)


BEGINNING = Beginning(to_settings(VALUES), 0.3)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "bag"
    write_offline_bag(path, BEGINNING, 0.4, planned=PLANNED)
    return path


def test_the_figures_are_those_of_the_run_in_the_bag():
    run = Run(BEGINNING)
    run.begin(0)
    for planned in PLANNED:
        list(run.advance_to(planned.delay))
        apply_change(run.control, planned.change)
    list(run.advance_to(400 * MILLISECOND))
    ensemble = run_ensemble(BEGINNING.settings.configuration, 0.4, [0.3], planned=PLANNED)
    [member] = ensemble.members
    assert member.figures["depth"] == run.simulation.depth
    feed, energy = member.feed, member.account
    assert abs(feed.residual(energy.weight_on_bit_work)) < 1e-12


@pytest.mark.parametrize("at", [0.0567, 0.3])
def test_a_fork_goes_on_with_the_same_bits(bag, tmp_path, at):
    write_fork(bag, tmp_path / "fork", at)
    since = round(at * 1000 * MILLISECOND)
    rest = [[each for each in held(path) if each[0] > since] for path in (tmp_path / "fork", bag)]
    assert rest[0] == rest[1]
    assert verify(bag).proved
    assert verify(tmp_path / "fork").proved


def test_a_fork_with_feeds_of_its_own_is_proved(bag, tmp_path):
    changes = Changes(
        planned=(Planned(0, Feed("rate", -5e-3)), Planned(90 * MILLISECOND, Feed("rate", 5e-3))),
        replaces_commands=True,
    )
    fork = write_fork(bag, tmp_path / "fork", 0.1, 0.3, changes)
    assert fork.warnings == ()
    assert verify(tmp_path / "fork").proved


def test_a_fork_of_a_feed_takes_no_weight_on_bit(bag, tmp_path):
    with pytest.raises(ParameterError, match="weight_on_bit cannot be commanded with feed_model"):
        write_fork(bag, tmp_path / "fork", 0.1, 0.1, parameter_changes({"weight_on_bit": 5.0}))
