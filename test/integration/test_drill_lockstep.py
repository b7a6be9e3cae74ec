"""A drill that waits to be stepped: states, steps and resets."""

import pytest
from builtin_interfaces.msg import Time
from drill_client import SECOND, duration, nanoseconds, stamps
from rpud_msgs.msg import Result, SimulationState, Status
from rpud_msgs.srv import (
    GetSimulationState,
    RunToTime,
    SetSimulationState,
    StepSimulation,
)

PARAMETERS = {"start_paused": True, "publish_clock": True}


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill("/stepped", **PARAMETERS)


@pytest.fixture
def client(drill, connect):
    """At time zero, paused."""
    client = connect("/stepped")
    client.begin()
    return client


def state_of(client):
    request = GetSimulationState.Request()
    return client.call(GetSimulationState, "simulation/get_state", request).state.state


def run_to(client, stamp):
    seconds, rest = divmod(stamp, SECOND)
    request = RunToTime.Request(time=Time(sec=seconds, nanosec=rest))
    return client.call(RunToTime, "simulation/run_to", request)


def try_step(client, seconds):
    request = StepSimulation.Request(duration=duration(seconds))
    return client.call(StepSimulation, "simulation/step", request)


def test_at_a_standstill_the_clock_is_still_published(client):
    reached = client.step(0.25)
    clock = client.listen("/clock")
    client.until(lambda: len(clock) >= 5)
    assert {nanoseconds(message.clock) for message in clock} == {reached}


def test_it_plays_pauses_and_stops_with_the_results_of_the_standard(client):
    playing, paused, stopped = (
        SimulationState.STATE_PLAYING,
        SimulationState.STATE_PAUSED,
        SimulationState.STATE_STOPPED,
    )
    already = SetSimulationState.Response.ALREADY_IN_TARGET_STATE
    assert client.set_state(paused).result == already
    assert client.set_state(playing).result == Result.RESULT_OK
    assert client.set_state(playing).result == already
    assert state_of(client) == playing
    for refused in (try_step(client, 0.01), run_to(client, 1000 * SECOND)):
        assert refused.result.result == Result.RESULT_OPERATION_FAILED
        assert refused.result.error_message == "it is playing, not paused, as after `rpud pause`"
    clock = client.listen("/clock")
    client.until(lambda: len(clock) > 10)
    assert client.set_state(stopped).result == Result.RESULT_OK
    assert client.set_state(stopped).result == already
    assert (
        try_step(client, 0.01).result.error_message
        == "it is stopped, not paused, as after `rpud pause`"
    )
    client.until(lambda: client.status[-1].state == Status.STATE_STOPPED)
    assert stamps(client.status[-1:])[0] == 0
    assert client.set_state(paused).result == Result.RESULT_OK
    assert client.step(0.02) == SECOND // 50
    unknown = client.set_state(9)
    assert unknown.result == Result.RESULT_FEATURE_UNSUPPORTED
    assert unknown.error_message == "state 9 is unknown"


@pytest.mark.extended
def test_a_signal_ends_a_step_and_its_client_gets_an_answer(start_drill, connect):
    process = start_drill("/ended", **PARAMETERS)
    client = connect("/ended")
    request = StepSimulation.Request(duration=duration(1e6))
    step = client.call_async(StepSimulation, "simulation/step", request)
    client.until(lambda: client.status and client.status[-1].state == Status.STATE_RUNNING)
    process.terminate()
    client.until(step.done)
    assert step.result().result.error_message == "interrupted: the drill has stopped"
    assert process.wait() == 0
    assert "Traceback" not in process.output
