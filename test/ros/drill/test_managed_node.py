"""What a client may ask of a managed node never ends it."""

import math

import pytest
import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from support import PATIENCE

from rpud_sim.ros.drill.managed_node import ManagedNode


@pytest.fixture
def node(nodes):
    nodes.append(ManagedNode("managed"))
    nodes[0].declare_parameter("gain", 1.0)
    return nodes[0]


def call(node, kind, name, **fields):
    executor = SingleThreadedExecutor()
    client_node = rclpy.create_node("client")
    client = client_node.create_client(kind, f"managed/{name}")
    for each in (node, client_node):
        executor.add_node(each)
    try:
        assert client.wait_for_service(PATIENCE)
        future = client.call_async(kind.Request(**fields))
        executor.spin_until_future_complete(future, PATIENCE)
        return future.result()
    finally:
        executor.shutdown()
        client_node.destroy_node()


@pytest.fixture
def set_parameters(node):
    """Set parameters by both services, and give the results and reasons of one by one."""

    def ask(*parameters):
        together = call(
            node, SetParametersAtomically, "set_parameters_atomically", parameters=parameters
        ).result
        changed = node.get_parameter("gain").value != 1.0
        node.set_parameters([Parameter("gain", value=1.0)])
        results = call(node, SetParameters, "set_parameters", parameters=parameters).results
        found = [(result.successful, result.reason) for result in results]
        assert (together.successful, together.reason) == min(found)  # the refusal, if there is one
        assert changed == together.successful
        return found

    return ask


def parameter(kind, name="gain", **value):
    return ParameterMessage(name=name, value=ParameterValue(type=kind, **value))


KNOWN = parameter(ParameterType.PARAMETER_DOUBLE, double_value=2.0)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (parameter(77), "'gain' has the type 77, which is none"),
        (parameter(4, string_value="much"), "gain is of another type: expected double, given str"),
        (parameter(1, bool_value=True), "gain is of another type: expected double, given bool"),
        (parameter(3, "gian"), "parameter 'gian' is unknown; did you mean gain?"),
        (
            parameter(3, "gravity", double_value=math.nan),
            "gravity = nan m/s^2 is outside its range [0, 100] m/s^2",
        ),
    ],
)
def test_a_refusal_names_the_parameter_and_its_neighbours_are_set(
    node, set_parameters, bad, reason
):
    node.declare_parameter("gravity", 9.81)
    [(successful, said), neighbour] = set_parameters(bad, KNOWN)
    assert not successful
    assert said.startswith(reason)
    assert neighbour == (True, "")


@pytest.mark.parametrize(
    ("given", "number"),
    [
        (KNOWN, 2.0),
        (parameter(ParameterType.PARAMETER_INTEGER, integer_value=5), 5.0),
        # As ros2 param set and load send 1e-06.
        (parameter(ParameterType.PARAMETER_STRING, string_value="1e-06"), 1e-6),
    ],
)
def test_what_stands_for_a_number_is_one(set_parameters, node, given, number):
    assert set_parameters(given) == [(True, "")]
    assert node.get_parameter("gain").value == number


def test_a_handler_that_raises_an_error_answers_with_an_empty_response(node, capfd):
    def handler(request, response):
        response.success = True
        return 1 / 0

    node.create_service(Trigger, "~/divide", handler)
    for _ in range(2):
        assert not call(node, Trigger, "divide").success
    said = "request rejected: Trigger: it raised ZeroDivisionError: division by zero"
    assert capfd.readouterr().err.count(said) == 2
