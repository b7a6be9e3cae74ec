"""Parameters of a drill at work: those that may change do so all or none."""

import re

import pytest
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters
from rclpy.qos import qos_profile_parameter_events
from rpud_msgs.msg import Result
from rpud_msgs.srv import ResetSimulation
from support import extended

from rpud_sim.simulation.configuration import CHANGEABLE

NODE = "/changed/drill_node"


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill("/changed", start_paused=True, publish_clock=True)


@pytest.fixture
def client(drill, connect):
    """To a drill in the rock, at time zero and paused."""
    client = connect("/changed")
    assert all(result.successful for result in client.set_each(regime="drilling", gravity=9.81))
    client.begin()
    return client


def get(client, *names):
    request = GetParameters.Request(names=names)
    values = client.call(GetParameters, f"{NODE}/get_parameters", request).values
    return [value.string_value or value.double_value for value in values]


@pytest.mark.parametrize(
    ("program", "words", "said"),
    [
        (
            "drill_node",
            ["-p", "wieght_on_bit:=18.0"],
            r"drill_node: wieght_on_bit is not a parameter; did you mean weight_on_bit\?",
        ),
        extended("drill_node", ["--params-file", "nowhere.yaml"], "drill_node: .*nowhere.yaml.*"),
        extended("recorder", ["-p", "use_sim_time:=maybe"], ".*use_sim_time.*"),
    ],
)
def test_a_start_with_what_is_no_parameter_or_no_file_is_one_line(
    process, tmp_path, program, words, said
):
    out = ("--out", tmp_path / "bag") if program == "recorder" else ()
    started = process(program, *out, "--ros-args", *words)
    assert started.wait() == 2
    assert re.fullmatch(said, started.output)
    assert list(tmp_path.iterdir()) == []


CHANGED = {
    "gravity": 3.7,
    "drill_tool_restitution": 0.5,
    "command_timeout": 9.0,
    "command_loss_ramp": 0.25,
}


def test_a_reset_of_the_state_restores_the_parameters_of_the_start(client):
    before, heard = get(client, *CHANGEABLE), []
    events = "/parameter_events"
    client.node.create_subscription(
        ParameterEvent, events, heard.append, qos_profile_parameter_events
    )
    client.until(lambda: client.node.count_publishers(events))
    assert all(result.successful for result in client.set_each(**CHANGED, real_time_factor=2.0))
    assert client.engage(False).success
    client.until(lambda: client.status[-1].regime == "free")
    assert client.reset(ResetSimulation.Request.SCOPE_TIME).result == Result.RESULT_OK
    assert get(client, "regime", *CHANGED) == ["free", *CHANGED.values()]
    heard.clear()
    assert client.reset(ResetSimulation.Request.SCOPE_STATE).result == Result.RESULT_OK
    # Who sets the pace of the simulation keeps it.
    assert get(client, "real_time_factor") == [2.0]
    assert client.set_each(real_time_factor=1.0)[0].successful
    assert get(client, *CHANGEABLE) == before

    def restored():
        mine = [event for event in heard if event.node == NODE]
        return {parameter.name for event in mine for parameter in event.changed_parameters}

    client.until(lambda: restored() >= {"regime", *CHANGED})
