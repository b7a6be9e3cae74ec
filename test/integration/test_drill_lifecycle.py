"""A managed drill: nothing is driven unless it is active, and no request ends it."""

import pytest
from drill_client import (
    ACTIVATE,
    CLEANUP,
    CONFIGURE,
    DEACTIVATE,
    SECOND,
    Client,
    stamps,
)
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rpud_msgs.msg import Result, SimulationState, Status, WeightOnBit
from rpud_msgs.srv import ListFaults, StepSimulation
from support import extended

from rpud_sim.ros.client import DrillClient, NoDrillError

NODE = "/managed/drill_node"
PARAMETERS = {"autostart": False, "start_paused": True, "publish_clock": True}
# Elastic masses without a drive would bounce for ever.
INELASTIC = {"actuator_restitution": 0.8, "drill_tool_restitution": 0.8}
WAITING = "waiting for the transitions configure and activate"
WAYS = {
    "active": (DEACTIVATE, CLEANUP),
    "inactive": (CLEANUP,),
    "unconfigured": (),
}


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario") / "scenario.yaml"
    path.write_text("faults: []\n")
    return path


@pytest.fixture(scope="module")
def drill(start_module_drill, scenario):
    return start_module_drill("/managed", WAITING, scenario=scenario, **PARAMETERS, **INELASTIC)


@pytest.fixture
def client(drill, connect):
    """To a drill that is not configured."""
    with Client("/managed") as before:
        for transition in WAYS[state_of(before)]:
            assert before.change(transition)
        before.until(lambda: before.node.count_publishers("/managed/status") == 0)
    return connect("/managed")


def state_of(client):
    return client.call(GetState, f"{NODE}/get_state", GetState.Request()).current_state.label


def hard_impacts(impacts, since):
    """Give those that are more than a mass at rest, which weighs 0.05 N."""
    return [
        impact
        for impact, stamp in zip(impacts, stamps(impacts), strict=True)
        if stamp >= since and impact.peak_force > 1.0
    ]


def test_without_autostart_it_waits_and_refuses_requests_with_that_reason(client):
    assert state_of(client) == "unconfigured"
    step = client.call(StepSimulation, "simulation/step", StepSimulation.Request())
    assert step.result.result == Result.RESULT_INCORRECT_STATE
    assert step.result.error_message == "the node has not been activated"
    refused = client.set_state(SimulationState.STATE_PLAYING)
    assert refused.result == Result.RESULT_INCORRECT_STATE
    injected = client.inject("lost_preload")
    assert not injected.success
    assert injected.message == "the node has not been activated"
    engaged = client.engage(False)
    assert (engaged.success, engaged.message) == (False, "the node has not been configured")
    assert client.call(ListFaults, "list_faults", ListFaults.Request()).faults == []
    assert client.node.count_publishers("/managed/nodal_plane") == 0
    with (
        DrillClient("/managed", patience=1.5) as commander,
        pytest.raises(NoDrillError, match=r"published no status within 1.5 s: it is still "),
    ):
        commander.press(1.0)


def test_drive_and_weight_on_bit_are_zero_unless_it_is_active(client):
    def last():
        status = client.status[-1]
        return status.state, status.weight_on_bit, status.drive_enabled

    impacts, planes = client.listen("contact_force"), client.listen("nodal_plane")
    assert client.change(CONFIGURE)
    # At least the latched one, and one for each of two seconds.
    client.until(lambda: len(client.status) >= 3)
    assert last() == (Status.STATE_INACTIVE, 0.0, False)
    assert client.change(ACTIVATE)
    client.until(lambda: last() == (Status.STATE_PAUSED, 8.0, True))
    client.step(0.5)
    client.command(WeightOnBit(force=20.0))
    client.until(lambda: client.status[-1].weight_on_bit == 20.0)
    assert client.change(DEACTIVATE)
    client.until(lambda: last() == (Status.STATE_INACTIVE, 0.0, False))
    # The drill goes on: the motion that is left dies away, and nothing strikes any more.
    client.step(2.0)
    client.until(lambda: stamps(planes[-1:])[0] == stamps(client.status[-1:])[0] == 5 * SECOND // 2)
    assert client.status[-1].impacts > 50
    assert hard_impacts(impacts, 3 * SECOND // 2) == []
    assert abs(planes[-1].velocity) < 1e-6
    # Commands begin again from the parameters.
    assert client.change(ACTIVATE)
    client.until(lambda: last() == (Status.STATE_PAUSED, 8.0, True))
    client.step(0.5)
    client.until(lambda: len(hard_impacts(impacts, 5 * SECOND // 2)) > 50)


@pytest.mark.parametrize("transition", [ACTIVATE, 77])
def test_an_impossible_transition_is_answered_and_ends_nothing(client, drill, transition):
    assert not client.change(transition)
    drill.wait_for_line("request rejected: the state unconfigured has no transition ")
    assert state_of(client) == "unconfigured"
    assert drill.running


def test_what_is_set_while_it_is_unconfigured_is_in_force_at_the_next_activation(client):
    def set_weight(force):
        return client.set_each(weight_on_bit=force)[0].successful

    assert set_weight(20.0)
    assert client.change(CONFIGURE)
    assert not set_weight(30.0)
    assert client.engage(False).success
    assert client.change(ACTIVATE)
    client.until(lambda: client.status and client.status[-1].weight_on_bit == 20.0)
    assert client.status[-1].regime == "free"
    assert client.engage(True).success
    client.until(lambda: client.status[-1].regime == "drilling")
    assert client.reset().result == Result.RESULT_OK
    client.until(lambda: client.status[-1].regime == "free")
    assert client.change(DEACTIVATE)
    assert client.change(CLEANUP)
    assert set_weight(10.0)
    assert client.change(CONFIGURE)
    assert client.change(ACTIVATE)
    client.until(lambda: client.status[-1].weight_on_bit == 10.0)


@pytest.mark.parametrize(
    ("before", "transition"),
    [
        extended((), Transition.TRANSITION_UNCONFIGURED_SHUTDOWN),
        ((CONFIGURE, ACTIVATE), Transition.TRANSITION_ACTIVE_SHUTDOWN),
    ],
)
def test_a_shutdown_ends_the_process(start_drill, connect, before, transition):
    process, node = start_drill("/shut", WAITING, **PARAMETERS), "/shut/drill_node"
    client = connect("/shut")
    # A drill that has ended cannot be asked again. One that answers the later client knows both.
    client.service(ChangeState, f"{node}/change_state")
    client.call(GetState, f"{node}/get_state", GetState.Request())
    for each in (*before, transition):
        assert client.change(each, node)
    # It is there a moment longer: a response gets lost if its sender leaves at once.
    state = client.call(GetState, f"{node}/get_state", GetState.Request()).current_state
    assert state.label == "finalized"
    assert process.wait() == 0
    assert "Traceback" not in process.output
