"""The standard interface of simulators, where `simulation_interfaces` is installed."""

import pytest
from rpud_msgs.msg import Status

pytest.importorskip("simulation_interfaces", reason="simulation_interfaces is not installed")

from simulation_interfaces.msg import Result, SimulationState
from simulation_interfaces.srv import (
    GetSimulationState,
    ResetSimulation,
    SetSimulationState,
    StepSimulation,
)


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill("/standard", start_paused=True, publish_clock=True)


@pytest.fixture
def client(drill, connect):
    """At time zero and paused."""
    client = connect("/standard")
    set_state(client, SimulationState.STATE_PAUSED)
    request = ResetSimulation.Request()
    response = client.call(ResetSimulation, "reset_simulation", request)
    assert response.result.result == Result.RESULT_OK
    client.until(lambda: client.status and client.status[-1].state == Status.STATE_PAUSED)
    return client


def set_state(client, state):
    request = SetSimulationState.Request()
    request.state.state = state
    return client.call(SetSimulationState, "set_simulation_state", request).result.result


def step(client, steps):
    request = StepSimulation.Request(steps=steps)
    return client.call(StepSimulation, "step_simulation", request).result


def test_states_follow_each_other_and_steps_are_refused_unless_paused(client):
    def state():
        request = GetSimulationState.Request()
        return client.call(GetSimulationState, "get_simulation_state", request).state.state

    already = SetSimulationState.Response.ALREADY_IN_TARGET_STATE
    assert state() == SimulationState.STATE_PAUSED
    assert set_state(client, SimulationState.STATE_PLAYING) == Result.RESULT_OK
    assert set_state(client, SimulationState.STATE_PLAYING) == already
    assert state() == SimulationState.STATE_PLAYING
    refused = step(client, 1)
    assert refused.result == Result.RESULT_OPERATION_FAILED
    assert refused.error_message == "it is playing, not paused, as after `rpud pause`"
    assert set_state(client, SimulationState.STATE_STOPPED) == Result.RESULT_OK
    assert state() == SimulationState.STATE_STOPPED
    unsupported = set_state(client, SimulationState.STATE_NO_WORLD)
    assert unsupported == Result.RESULT_FEATURE_UNSUPPORTED
