"""A drill on a feed: bits, energies, refusals, and what a supervisor does with it."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rpud_msgs.msg import Feed as FeedMessage
from support import examples

from rpud_sim.drilling.feed import STOPPED
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation import Fault, Feed, Simulation, WeightOnBit, preset, to_configuration
from rpud_sim.simulation.changes import Planned, read_commands
from rpud_sim.simulation.checkpoints import Checkpoints
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.control import Control
from rpud_sim.simulation.energy_account import EnergyAccount
from rpud_sim.simulation.feed_account import FeedAccount
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.together import one_by_one

MILLISECOND = 1_000_000
SECOND = 1000 * MILLISECOND
ARM = {"feed_model": "arm"}
RIGID = {**ARM, "arm_stiffness": 0.0, "anchoring_force": 1e3}
DRILLS = {**ARM, "rock_model": "specific_energy", "initial_feed": 0.004}


def made(**values):
    return Simulation(to_configuration(values), 0.3)


def drilled(simulation, *times):
    """Advance to times; return the numbers of all segments and impacts."""
    blocks = [simulation.advance_to(time) for time in times]
    segments = [row for block in blocks for row in block.segments.tolist()]
    return (
        segments + blocks[-1].open_segment.tolist(),
        [row for block in blocks for row in block.impacts.tolist()],
    )


# ---- bits


@given(st.floats(1e-4, 0.04))
@settings(max_examples=10, deadline=None)
def test_a_rigid_arm_at_rest_without_rock_model_gives_the_bits_of_its_weight_on_bit(position):
    fed = made(**RIGID, initial_feed=position)
    fed.apply(Feed("position", position))
    commanded = made(weight_on_bit=2000.0 * position)
    ends = (33 * MILLISECOND, 150 * MILLISECOND)
    assert fed.weight_on_bit == 2000.0 * position
    assert drilled(fed, *ends) == drilled(commanded, *ends)


def test_a_motion_without_contact_gives_the_bits_before_drilling():
    fed = made(**RIGID, initial_feed=-0.05)
    fed.apply(Feed("rate", 1e-3))
    drill = dataclasses.asdict(preset("drilling"))
    free = made(**{**drill, "weight_on_bit": 0.0, "regime": "free"})
    assert drilled(fed, 100 * MILLISECOND) == drilled(free, 100 * MILLISECOND)


@given(st.lists(st.integers(1, 119_999_999), max_size=6))
@settings(max_examples=15, deadline=None)
def test_bits_do_not_depend_on_how_the_time_is_divided(stops):
    end = 120 * MILLISECOND
    states = []
    for division in ((), sorted({*stops})):
        simulation = made(**DRILLS, arm_play=1e-4)
        simulation.apply(Feed("rate", 2e-3))
        accounts = FeedAccount()
        for stop in (*division, end):
            block = simulation.advance_to(stop)
            accounts += block.feed
        states.append((block.open_segment.tolist(), simulation.process, simulation.depth))
    assert states[0] == states[1]


def test_the_drill_gets_into_the_rock_and_out_again():
    simulation = made(**ARM, initial_feed=-1e-3, rock_model="specific_energy")
    simulation.apply(Feed("rate", 5e-3))
    reached = [simulation.advance_to(k * 20 * MILLISECOND).process.mount for k in range(1, 51)]
    assert not reached[0].in_contact
    assert reached[-1].in_contact
    assert simulation.depth > 0.0
    deep = simulation.depth
    simulation.apply(Feed("rate", -5e-3))
    block = simulation.advance_to(2500 * MILLISECOND)
    assert not block.process.mount.in_contact
    assert simulation.weight_on_bit == 0.0
    assert simulation.depth < 3 * deep


# ---- energy


def residuals(simulation, times):
    energy, feed = EnergyAccount(), FeedAccount()
    for time in times:
        block = simulation.advance_to(time)
        energy += EnergyAccount.of(block)
        feed += block.feed
    return energy, feed


@given(
    stiffness=st.sampled_from([0.0, 3e3, 2e4, 1e6]),
    damping=st.sampled_from([1.0, 200.0, 1e4]),
    play=st.sampled_from([0.0, 2e-4]),
    anchoring=st.sampled_from([2.0, 12.0, 100.0]),
    start=st.floats(-1e-3, 8e-3),
    rates=st.lists(st.floats(-5e-3, 5e-3), min_size=1, max_size=3),
    kind=st.sampled_from(["", "lost_preload", "load_spring_binding"]),
)
@settings(max_examples=examples(60), deadline=None)
def test_both_accounts_close(stiffness, damping, play, anchoring, start, rates, kind):
    simulation = made(
        **ARM,
        arm_stiffness=stiffness,
        arm_damping=damping,
        arm_play=play,
        anchoring_force=anchoring,
        initial_feed=start,
        rock_model="specific_energy",
    )
    energy, feed = EnergyAccount(), FeedAccount()
    for number, rate in enumerate(rates):
        simulation.apply(Feed("rate", rate))
        if kind and number == 1:
            simulation.inject(Fault(kind))
        end = simulation.time + 61_234_567
        more, fed = residuals(simulation, (end - 40 * MILLISECOND, end))
        energy, feed = energy + more, feed + fed
    sizes = [abs(each) for each in dataclasses.astuple(feed)]
    size = max(*sizes, energy.actuator_work, 1e-3)
    assert abs(energy.residual) < 1e-11 * size
    assert abs(feed.residual(energy.weight_on_bit_work)) < 1e-11 * size


def test_a_changed_load_spring_is_in_the_account():
    simulation = made(**DRILLS)
    energy, feed = residuals(simulation, (50 * MILLISECOND,))
    configuration = simulation.configuration
    parameters = configuration.parameters.replace(load_spring_rate=2600.0)
    simulation.configure(dataclasses.replace(configuration, parameters=parameters))
    more, fed = residuals(simulation, (120 * MILLISECOND,))
    energy, feed = energy + more, feed + fed
    assert feed.spring_changes > 0.0
    assert abs(feed.residual(energy.weight_on_bit_work)) < 1e-12


def test_without_a_feed_there_is_no_account_of_it():
    block = made().advance_to(10 * MILLISECOND)
    assert block.feed is None
    assert block.process.mount is None


# ---- commands


@pytest.mark.parametrize(
    ("values", "command", "reason"),
    [
        ({}, Feed("rate", 1e-3), "a feed cannot be commanded with feed_model = none"),
        (ARM, WeightOnBit(3.0), "weight_on_bit cannot be commanded with feed_model = arm"),
        (ARM, Feed("rate", 0.1), "feed rate = 0.1 m/s is outside its range"),
        (ARM, Feed("position", 0.9), "feed position = 0.9 m is outside its range"),
    ],
)
def test_a_command_that_the_drill_cannot_take_is_refused_and_changes_nothing(
    values, command, reason
):
    simulation = made(**values)
    control = Control(simulation, 0.0, 0.5)
    before = simulation.applied
    for take in (simulation.apply, control.apply):
        with pytest.raises(ParameterError, match=reason):
            take(command)
    control.act()
    assert simulation.applied == before


@pytest.mark.parametrize(
    ("mode", "value", "reason"),
    [
        ("speed", 1.0, "feed mode = 'speed' is not one of rate, position"),
        ("rate", float("nan"), "feed rate = nan"),
        ("position", 3.0, "feed position = 3 m is outside its range"),
    ],
)
def test_a_feed_is_checked(mode, value, reason):
    with pytest.raises(ParameterError, match=reason):
        Feed(mode, value)


@pytest.mark.parametrize("command", [Feed("rate", 2e-3), Feed("position", 0.02)])
def test_lost_commands_stop_the_feed(command):
    simulation = made(**ARM)
    control = Control(simulation, 0.1, 0.1)
    control.apply(command)
    for time in range(50, 301, 50):
        simulation.advance_to(time * MILLISECOND)
        control.act()
    assert control.commands_lost
    assert simulation.applied.feed == Feed("rate", 0.0)
    assert simulation.process.mount.rate == pytest.approx(0.0, abs=1e-9)
    control.apply(command)
    control.act()
    assert simulation.applied.feed == command


def test_an_inactive_drill_does_not_feed():
    simulation = made(**ARM)
    control = Control(simulation, 0.0, 0.5, active=False)
    control.apply(Feed("rate", 1e-3))
    control.act()
    simulation.advance_to(50 * MILLISECOND)
    assert simulation.process.mount.feed == 0.0


# ---- journal and checkpoints


def started(values=DRILLS):
    run = Run(Beginning(to_settings(values), 0.3, 5), Journal())
    run.begin(0)
    run.control.apply(Feed("rate", 2e-3))
    return run


@given(st.integers(0, 90 * MILLISECOND))
@settings(max_examples=8, deadline=None)
def test_a_checkpoint_goes_on_with_the_same_bits(time):
    run, checkpoints = started(), Checkpoints()
    list(run.advance_to(time))
    checkpoints.save("here", run)
    other = run.copy(Journal())

    def rest(run):
        found = [repr(each) for each in run.advance_to(140 * MILLISECOND) if each[1] != "journal"]
        run.control.apply(Feed("rate", -1e-3))
        found += [repr(each) for each in run.advance_to(200 * MILLISECOND) if each[1] != "journal"]
        return found, run.simulation.process

    found = rest(other)
    assert rest(run) == found
    assert rest(checkpoints.find("here"))[1] == found[1]


def test_messages_are_the_same_one_by_one_and_together():
    one, other = started(), started()
    found = [repr(each) for each in one.advance_to(300 * MILLISECOND)]
    together = [repr(each) for each in one_by_one(other.advance_together(300 * MILLISECOND))]
    assert together == found


def test_a_command_file_holds_feeds(tmp_path):
    file = tmp_path / "commands.yaml"
    file.write_text(
        "commands:\n- {time: 0.5, feed: {position: 0.002}}\n- {time: 0, feed: {rate: 1.0e-3}}\n"
    )
    assert read_commands(file).planned == (
        Planned(0, Feed("rate", 1e-3)),
        Planned(SECOND // 2, Feed("position", 2e-3)),
    )
    for text in ("0.1", "{rate: 1, position: 2}", "{speed: 1}", "{rate: fast}"):
        file.write_text(f"commands:\n- {{time: 0, feed: {text}}}\n")
        with pytest.raises(ParameterError, match="command 1: feed"):
            read_commands(file)


# ---- force control


def feed_back(gain, integral, stiffness, samples=120, sampled=20):
    """Let a PI controller with one sample of delay feed; return W - target at each sample."""
    arm = RIGID if stiffness == 0.0 else {**ARM, "arm_stiffness": stiffness}
    simulation = made(
        **{**arm, "anchoring_force": 1e3, "feed_rate_limit": 1.0, "feed_maximum": 1.0},
        initial_feed=0.01,
        drive_enabled=False,
    )
    target = simulation.weight_on_bit + 0.01
    errors, summed, heard = [], 0.0, 0.0
    for number in range(samples):
        error = target - heard if number else 0.0
        summed += integral * sampled * 1e-3 * error
        simulation.apply(Feed("rate", min(max(gain * error + summed, -1.0), 1.0)))
        heard = simulation.weight_on_bit
        simulation.advance_to(simulation.time + sampled * MILLISECOND)
        errors.append(simulation.weight_on_bit - target)
    return np.array(errors)


def spectral_radius(gain, integral, stiffness, damping=200.0, spring=2000.0, sampled=20):
    """Of the sampled loop: W, what the controller heard, the feed and the integral."""
    # State: mount, feed, heard W, summed; the target is zero.
    step = np.eye(4)
    if stiffness == 0.0:
        step[0] = [0.0, 1.0, 0.0, 0.0]
    else:
        decay = np.exp(-(stiffness + spring) / damping * 1e-3)
        step[0] = [decay, (1.0 - decay) * stiffness / (stiffness + spring), 0.0, 0.0]
    control = np.eye(4)
    control[3] = [0.0, 0.0, -integral * sampled * 1e-3, 1.0]
    rate = gain * np.array([0.0, 0.0, -1.0, 0.0]) + control[3]
    hear = np.eye(4)
    hear[2] = [spring, 0.0, 0.0, 0.0]
    # Within a sample the rate is constant: carry it as a fifth state.
    whole = np.zeros((5, 5))
    whole[:4, :4] = hear @ control
    whole[2, :4] = hear[2]
    whole[4, :4] = rate
    inner = np.eye(5)
    move = np.eye(5)
    move[1, 4] = 1e-3
    if stiffness == 0.0:
        inner[0, :4] = step[0]
        one = inner @ move
    else:
        inner[0, :4] = step[0]
        one = move @ inner
    loop = np.linalg.matrix_power(one, sampled) @ whole
    return np.abs(np.linalg.eigvals(loop)).max()


@pytest.mark.parametrize("stiffness", [0.0, 5e3, 2e4])
@pytest.mark.parametrize(
    ("gain", "integral"), [(0.005, 0.01), (0.01, 0.02), (0.015, 0.02), (0.035, 0.02), (0.05, 0.02)]
)
def test_force_control_by_the_feed_is_stable_where_the_theory_says_so(stiffness, gain, integral):
    radius = spectral_radius(gain, integral, stiffness)
    errors = np.abs(feed_back(gain, integral, stiffness))
    assert abs(radius - 1.0) > 0.01  # or it would not be decided in this time
    if radius < 1.0:
        assert errors[-20:].max() < 0.2 * errors[:20].max()
    else:
        assert errors[-20:].max() > 3.0 * errors[:20].max()


def test_the_accounts_close_in_strata_with_rotation_and_through_a_fault():
    simulation = made(**ARM, strata="sandstone", rotation_model="friction_drive", initial_feed=3e-3)
    simulation.apply(Feed("rate", 2e-3))
    energy, feed = residuals(simulation, (100 * MILLISECOND,))
    simulation.inject(Fault("choking"))
    more, fed = residuals(simulation, (250 * MILLISECOND, 300_700_000))
    energy, feed = energy + more, feed + fed
    assert simulation.depth > 0.0
    assert feed.penetration_work > 0.0
    assert abs(feed.residual(energy.weight_on_bit_work)) < 1e-11
    rotor = simulation.process.rotation.work
    assert rotor.drive > 0.0
    assert abs(rotor.residual) < 1e-12


def test_a_feed_that_is_in_force_already_adds_no_entry_to_the_journal():
    journal = Journal()
    configuration = to_settings(ARM).configuration
    simulation = Simulation(configuration, journal=journal)
    for number, command in enumerate((STOPPED, Feed("rate", 1e-3), Feed("rate", 1e-3), STOPPED)):
        simulation.advance_to(number * MILLISECOND)
        simulation.apply(command)
    entries = [(entry.time, entry.content["value"]) for entry in journal.drain()]
    assert entries == [(MILLISECOND, 1e-3), (3 * MILLISECOND, 0.0)]
    assert simulation.applied.feed_time == 3 * MILLISECOND


def test_the_status_has_the_feed_in_force():
    run = Run(Beginning(to_settings(ARM)))
    run.begin(5)
    for _ in run.advance_to(MILLISECOND):
        pass
    run.control.apply(Feed("position", 2e-3))
    _, _, status = run.status("running", Bookkeeping())
    assert (status["feed_mode"], status["feed_value"]) == (FeedMessage.MODE_POSITION, 2e-3)
    assert status["feed_applied"] == {"sec": 0, "nanosec": MILLISECOND + 5}
    _, _, status = Run(Beginning(to_settings({}))).status("running", Bookkeeping())
    assert (status["feed_mode"], math.isnan(status["feed_value"])) == (FeedMessage.MODE_RATE, True)
