"""A mount that another simulator carries: its rule between samples, bits, refusals and loss."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from silent_drill import SilentDrill
from support import examples, refusal

from rpud_sim.simulation import Drive, MountMotion, to_configuration
from rpud_sim.simulation.changes import action_of, journal_form
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount
from rpud_sim.simulation.metrics import account_of
from rpud_sim.simulation.plan import Beginning, Journal, Plan
from rpud_sim.simulation.run import Run

MILLISECOND = 1_000_000
GIVEN = {"feed_model": "given", "feed_rate_limit": 1.0, "rock_model": "specific_energy"}


def made(command_timeout=None, command_loss_ramp=0.0, **values):
    watched = (
        {}
        if command_timeout is None
        else {"command_timeout": command_timeout, "command_loss_ramp": command_loss_ramp}
    )
    return SilentDrill(to_configuration({**GIVEN, **values}), 0.3, **watched)


def places(simulation, *times):
    """Places of the mount at times [ms]."""
    found = []
    for time in times:
        simulation.advance_to(round(time * MILLISECOND))
        found.append(simulation.process.mount.position)
    return found


def test_between_samples_the_mount_goes_on_at_the_velocity_of_the_last_one():
    simulation = made(initial_feed=4e-3)
    assert places(simulation, 10.0) == [4e-3]
    simulation.apply(MountMotion(4.5e-3, 2e-2))
    assert places(simulation, 11, 12, 17) == pytest.approx([4.52e-3, 4.54e-3, 4.64e-3], abs=1e-15)
    # A sample of the past, such as one that DDS delayed, acts as if it had come in time.
    simulation.apply(MountMotion(5e-3, -1e-2, sampled=7 * MILLISECOND))
    assert places(simulation, 18, 19.5) == pytest.approx([4.89e-3, 4.88e-3], abs=1e-15)
    simulation.apply(MountMotion(5e-3))
    assert places(simulation, 20, 40) == [5e-3, 5e-3]


def test_a_jump_is_made_up_at_the_limits_of_rate_and_place():
    simulation = made(feed_rate_limit=0.1, feed_maximum=0.011)
    simulation.apply(MountMotion(0.01, 0.1))
    found = places(simulation, 1, 50, 100, 103, 120)
    assert found == pytest.approx([1e-4, 5e-3, 0.01, 0.0103, 0.011], abs=1e-12)


def test_a_mount_at_rest_has_the_bits_of_a_rigid_arm():
    arm = {"feed_model": "arm", "arm_stiffness": 0.0, "anchoring_force": 1e3}
    blocks = [
        made(**values, initial_feed=5e-3).advance_to(150 * MILLISECOND) for values in ({}, arm)
    ]
    assert blocks[0].segments.tobytes() == blocks[1].segments.tobytes()
    assert blocks[0].impacts.tobytes() == blocks[1].impacts.tobytes()


@given(
    start=st.floats(-1e-3, 8e-3),
    samples=st.lists(
        st.tuples(st.floats(-1e-3, 8e-3), st.floats(-0.1, 0.1)), min_size=2, max_size=4
    ),
)
@settings(max_examples=examples(30), deadline=None)
def test_all_accounts_close(start, samples):
    simulation = made(initial_feed=start)
    energy, feed = EnergyAccount(), FeedAccount()
    for position, velocity in samples:
        simulation.apply(MountMotion(position, velocity))
        block = simulation.advance_to(simulation.time + 21_234_567)
        energy, feed = energy + account_of(block), feed + block.feed
    size = max(*map(abs, vars(feed).values()), energy.actuator_work, 1e-3)
    assert abs(energy.residual) < 1e-11 * size
    assert abs(feed.residual(energy.weight_on_bit_work)) < 1e-11 * size
    assert feed.guide_friction == feed.host_slip == feed.arm_stored == 0.0


@pytest.mark.parametrize("values", [(float("nan"), 0.0), (0.0, float("inf")), (2.0, 0.0)])
def test_a_sample_has_numbers_in_their_range(values):
    assert refusal(MountMotion, *values).startswith("mount ")


def test_a_mount_whose_samples_are_lost_stops_where_it_is():
    simulation = made(command_timeout=0.1, command_loss_ramp=0.1)
    simulation.apply(MountMotion(0.0, 0.01))
    for time in range(10, 301, 10):
        simulation.advance_to(time * MILLISECOND)
        simulation.run.watch()
    assert simulation.run.commands_lost
    assert simulation.applied.motion.velocity == 0.0
    # The velocity falls at each look: 0.11 s of all of it, and 10 ms each of nine tenths to one.
    assert places(simulation, 320, 400) == pytest.approx([1.55e-3, 1.55e-3], abs=1e-9)
    simulation.apply(MountMotion(2e-3, 0.01))
    simulation.run.watch()
    assert places(simulation, 401) == pytest.approx([2.01e-3], abs=1e-12)
    simulation.run.activate(False)
    assert places(simulation, 402, 500) == pytest.approx([2.01e-3] * 2, abs=1e-12)


def test_other_commands_do_not_stand_for_samples():
    simulation = made(command_timeout=0.05)
    simulation.apply(MountMotion(0.0, 0.01))
    for time in range(10, 201, 10):
        simulation.advance_to(time * MILLISECOND)
        simulation.apply(Drive(True, 90.0, 16e3))
        simulation.run.watch()
    assert simulation.run.commands_lost
    assert places(simulation, 300) == pytest.approx([6e-4], abs=1e-12)  # it made no jump


def test_the_journal_has_each_sample_once_and_repeats_it():
    journal = Journal()
    simulation = SilentDrill(to_configuration(GIVEN), 0.3, journal=journal)
    for command in (MountMotion(0.0), MountMotion(1e-3, 0.01), MountMotion(1e-3, 0.01)):
        simulation.apply(command)  # the first one is in force already, the last one repeats
    simulation.advance_to(MILLISECOND)
    simulation.apply(MountMotion(1e-3, 0.01))  # and here it goes back
    simulation.apply(MountMotion(2e-3, 0.01, sampled=-5))
    actions = [action_of(entry.kind, entry.content) for entry in journal.drain()]
    assert actions == [
        MountMotion(1e-3, 0.01, 0),
        MountMotion(1e-3, 0.01, MILLISECOND),
        MountMotion(2e-3, 0.01, -5),
    ]
    kind, content = journal_form(actions[0])
    for wrong in (0.5, "0", None, 1 << 63, -(1 << 63)):
        with pytest.raises(ValueError, match="is not a time"):
            action_of(kind, {**content, "sampled": wrong})


def test_the_status_has_the_motion_in_force():
    run = Run(Plan(Beginning(to_settings(GIVEN))))
    run.begin(5)
    list(run.advance_to(MILLISECOND))
    run.apply(MountMotion(2e-3, 1e-3))
    status = run.status().row(0)
    assert (status["mount_position"], status["mount_velocity"]) == (2e-3, 1e-3)
    assert status["mount_applied"] == {"sec": 0, "nanosec": MILLISECOND + 5}
    assert math.isnan(status["feed_rate"])
    assert math.isnan(status["feed_position"])
    status = Run(Plan(Beginning(to_settings({})))).status().row(0)
    assert status["mount_position"] != status["mount_position"]
