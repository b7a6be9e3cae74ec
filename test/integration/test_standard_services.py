"""The standard interface of simulators, where `simulation_interfaces` is installed."""

import pytest
from drill_client import SECOND
from rclpy.action import ActionClient
from rpud_msgs.msg import Status

pytest.importorskip("simulation_interfaces", reason="simulation_interfaces is not installed")

from action_msgs.msg import GoalStatus
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures
from simulation_interfaces.srv import (
    GetSimulationState,
    GetSimulatorFeatures,
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


@pytest.fixture
def action(client):
    action = ActionClient(client.node, SimulateSteps, "simulate_steps")
    client.until(action.server_is_ready)
    yield action
    action.destroy()


def set_state(client, state):
    request = SetSimulationState.Request()
    request.state.state = state
    return client.call(SetSimulationState, "set_simulation_state", request).result.result


def step(client, steps):
    request = StepSimulation.Request(steps=steps)
    return client.call(StepSimulation, "step_simulation", request).result


def accepted(client, action, steps, feedback=None):
    sent = action.send_goal_async(SimulateSteps.Goal(steps=steps), feedback)
    client.until(sent.done)
    assert sent.result().accepted
    return sent.result()


def result_of(client, goal):
    future = goal.get_result_async()
    client.until(future.done)
    return future.result()


def test_the_features_are_those_that_it_has(client):
    request = GetSimulatorFeatures.Request()
    features = client.call(GetSimulatorFeatures, "get_simulator_features", request).features
    assert list(features.features) == [
        SimulatorFeatures.SIMULATION_RESET,
        SimulatorFeatures.SIMULATION_RESET_TIME,
        SimulatorFeatures.SIMULATION_RESET_STATE,
        SimulatorFeatures.SIMULATION_RESET_SPAWNED,
        SimulatorFeatures.SIMULATION_STATE_GETTING,
        SimulatorFeatures.SIMULATION_STATE_SETTING,
        SimulatorFeatures.SIMULATION_STATE_PAUSE,
        SimulatorFeatures.STEP_SIMULATION_SINGLE,
        SimulatorFeatures.STEP_SIMULATION_MULTIPLE,
        SimulatorFeatures.STEP_SIMULATION_ACTION,
    ]


def test_a_step_is_a_period_of_the_telemetry(client):
    assert StepSimulation.Request().steps == 1
    assert step(client, 1).result == Result.RESULT_OK
    client.at(SECOND // 100)
    assert step(client, 24).result == Result.RESULT_OK
    client.at(SECOND // 4)
    client.step(0.001)
    assert step(client, 1).result == Result.RESULT_OK
    client.at(26 * SECOND // 100)


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
    assert refused.error_message == "it is playing, not paused"
    assert set_state(client, SimulationState.STATE_STOPPED) == Result.RESULT_OK
    assert state() == SimulationState.STATE_STOPPED
    unsupported = set_state(client, SimulationState.STATE_NO_WORLD)
    assert unsupported == Result.RESULT_FEATURE_UNSUPPORTED


def test_steps_as_an_action_report_each_one(client, action):
    # Feedback arrives only when the server has discovered the subscription.
    warm = []
    client.until(lambda: result_of(client, accepted(client, action, 1, warm.append)) and warm)
    client.reset()
    told = []
    end = result_of(client, accepted(client, action, 8, told.append))
    assert end.status == GoalStatus.STATUS_SUCCEEDED
    assert end.result.result.result == Result.RESULT_OK
    # rclpy's client drops feedback that arrives after the result.
    steps = [(it.feedback.completed_steps, it.feedback.remaining_steps) for it in told]
    assert steps == [(number, 8 - number) for number in range(1, len(told) + 1)]
    assert steps
    client.at(8 * SECOND // 100)


def test_steps_as_an_action_can_be_cancelled_and_exclude_other_steps(client, action):
    told = []
    goal = accepted(client, action, 10**7, told.append)
    client.until(lambda: told)
    cancelled = goal.cancel_goal_async()
    client.until(cancelled.done)
    end = result_of(client, goal)
    assert end.status == GoalStatus.STATUS_CANCELED
    completed = told[-1].feedback.completed_steps
    after = client.step(0.01)
    assert completed * SECOND // 100 < after < 10**7 * SECOND // 100
    assert client.step(0.01) == after + SECOND // 100


@pytest.mark.parametrize(
    ("steps", "state", "said"),
    [
        (3, SimulationState.STATE_PLAYING, "it is playing, not paused"),
        (0, SimulationState.STATE_PAUSED, "step = 0 s is outside its range (0, 1e+06] s"),
    ],
)
def test_steps_as_an_action_that_cannot_be_are_aborted(client, action, steps, state, said):
    set_state(client, state)
    end = result_of(client, accepted(client, action, steps))
    assert end.status == GoalStatus.STATUS_ABORTED
    assert end.result.result.result == Result.RESULT_OPERATION_FAILED
    assert end.result.result.error_message == said
