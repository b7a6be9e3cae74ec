"""Checkpoints: copies of a run that go on like it, by their names."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.rerun import MOST_CHECKPOINTS, CheckpointError, Checkpoints
from rpud_sim.simulation.run import Beginning, Run

MILLISECOND = 1_000_000
RESONANCE = {
    "actuator_model": "resonance",
    "generator": "tracking",
    "rock_model": "specific_energy",
}


def started(values):
    run = Run(Beginning(to_settings(values), 0.3, 5), Journal())
    run.begin(7)
    for kind in ("noise", "intermittent", "garbage", "delayed"):
        run.simulation.inject(Fault(kind, "contact_force"), 40 * MILLISECOND)
    return run


def go_on(run):
    """Go on and change something; return all messages as texts, in which NaN equals NaN."""
    messages = list(run.advance_to(run.time + 15 * MILLISECOND))
    run.control.apply(WeightOnBit(17.0))
    messages += run.advance_to(run.time + 33 * MILLISECOND)
    return [repr(message) for message in messages if message[1] != "journal"]


@settings(max_examples=8)
@given(time=st.integers(0, 50 * MILLISECOND), values=st.sampled_from([{}, RESONANCE]))
def test_a_copy_goes_on_like_its_run_and_by_itself(time, values):
    run = started(values)
    list(run.advance_to(time))
    first, second = run.copy(Journal()), run.copy(Journal())
    found = go_on(first)
    assert run.time == time
    assert go_on(second) == found
    assert go_on(run) == found


def test_a_checkpoint_stays_as_it_was_saved():
    run, checkpoints = started({}), Checkpoints()
    list(run.advance_to(11 * MILLISECOND))
    checkpoints.save("here", run)
    found = go_on(checkpoints.find("here"))
    assert go_on(checkpoints.find("here")) == found
    assert checkpoints.names == ("here",)


def test_a_name_is_checked_and_an_unknown_one_gets_a_hint():
    run, checkpoints = started({}), Checkpoints()
    with pytest.raises(CheckpointError, match="no checkpoint 'a'; none was saved"):
        checkpoints.find("a")
    checkpoints.save("before_the_rock", run)
    with pytest.raises(CheckpointError, match=r"'before_rock'; did you mean before_the_rock\?"):
        checkpoints.find("before_rock")
    for name in ("", "a b", "x" * 65, "a/b", "a\n"):
        with pytest.raises(CheckpointError, match="is no name of a checkpoint"):
            checkpoints.save(name, run)


def test_their_number_is_bounded():
    run, checkpoints = started({}), Checkpoints()
    for number in range(MOST_CHECKPOINTS):
        checkpoints.save(f"c{number}", run)
    with pytest.raises(CheckpointError, match=r"one more than 16 checkpoints: .* such as c0"):
        checkpoints.save("more", run)
    checkpoints.save("c0", run)
    assert checkpoints.names[-1] == "c0"
