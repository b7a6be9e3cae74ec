"""A drill in another process follows the messages that ros2_control's hardware interface sends."""

import math

import pytest
from ros2_control_hardware import Description, Hardware, arm_with_drill

from rpud_sim.simulation.fields import FEED_JOINT, ROTATION_JOINT

NAMESPACE = "/controlled"


@pytest.fixture(scope="module")
def drill(start_module_drill):
    models = {"feed_model": "arm", "rotation_model": "friction_drive", "initial_feed": -0.02}
    return start_module_drill(NAMESPACE, **models)


@pytest.fixture
def client(drill, connect):
    client = connect(NAMESPACE)
    client.until(lambda: client.status)
    return client


def hardware_of(client, **arguments):
    return Hardware(client, Description(arm_with_drill(drill=NAMESPACE, **arguments)))


def cycle_until(client, hardware, condition):
    """Let the hardware write in each turn, until a condition holds."""

    def turn():
        hardware.write()
        return condition()

    client.until(turn)


def reached(hardware, rate):
    """Whether the feed has a rate, up to rounding."""
    return abs(hardware.states[FEED_JOINT, "velocity"] - rate) < 1e-9


def test_states_of_both_joints_come_by_a_best_effort_subscription(client):
    hardware = hardware_of(client)
    client.until(lambda: hardware.heard > 1)
    assert all(math.isfinite(value) for value in hardware.states.values())
    assert hardware.states[ROTATION_JOINT, "velocity"] != 0.0


def test_a_velocity_moves_the_feed_and_is_not_sent_again_once_it_is_reached(client):
    hardware = hardware_of(client)
    for rate in (2e-3, 3e-6, 0.0):  # the second is far below the hardware's own threshold
        hardware.commands[FEED_JOINT, "velocity"] = rate
        cycle_until(client, hardware, lambda rate=rate: reached(hardware, rate))
        sent = len(hardware.sent)
        heard = hardware.heard
        cycle_until(client, hardware, lambda heard=heard: hardware.heard > heard + 5)
        assert len(hardware.sent) == sent
        # One value for two joints: the hardware leaves out what has no command interface.
        assert len(hardware.sent[-1].name) == 2
        assert list(hardware.sent[-1].velocity) == [rate]
