"""A plain rclpy client of the drill, as a user would write it."""

import contextlib
import itertools
import time

import rclpy
from builtin_interfaces.msg import Duration
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import Drive, Fault, Result, SimulationState, Status, WeightOnBit
from rpud_msgs.srv import (
    InjectFault,
    ResetSimulation,
    SetSimulationState,
    StepSimulation,
)
from std_srvs.srv import SetBool
from support import PATIENCE, Process

from rpud_sim.ros.drill.publishers import CLOCK, DESCRIPTION, OF_NODE
from rpud_sim.ros.graph import message_class
from rpud_sim.simulation.topics import TOPICS

SECOND = 1_000_000_000
OFFERED = {**TOPICS, **OF_NODE, "/clock": CLOCK, "robot_description": DESCRIPTION}
TELEMETRY = ("nodal_plane", "drill_tool", "reacting_force", "wrench", "joint_states")
PLENTY = QoSProfile(depth=5000)  # reliable, and longer than anything that a test waits for
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CONFIGURE = Transition.TRANSITION_CONFIGURE
ACTIVATE = Transition.TRANSITION_ACTIVATE
DEACTIVATE = Transition.TRANSITION_DEACTIVATE
CLEANUP = Transition.TRANSITION_CLEANUP
UNANSWERED = 50.0  # seconds after which a request is repeated


def start_drill(namespace, node="drill_node", **parameters):
    """Start a drill with a name of its node and parameters of ROS."""
    words = [word for item in parameters.items() for word in ("-p", "{}:={}".format(*item))]
    return Process(
        "drill_node", "--ros-args", "-r", f"__ns:={namespace}", "-r", f"__node:={node}", *words
    )


class Client:
    """A node in a context of its own, which subscribes to topics and gives commands.

    Attributes:
        status: every message of the topic `status` that was received.
    """

    def __init__(self, namespace="/rpud"):
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node("client", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._services = {}
        self._commands = {
            WeightOnBit: self.node.create_publisher(WeightOnBit, "command/weight_on_bit", 100),
            Drive: self.node.create_publisher(Drive, "command/drive", 100),
        }
        self.status = self.listen("status")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def listen(self, topic, qos=PLENTY):
        """Give the list that the messages of a topic are added to."""
        heard = []
        qos = LATCHED if topic in ("status", "faults", "journal") else qos
        self.node.create_subscription(message_class(OFFERED[topic].type), topic, heard.append, qos)
        return heard

    def until(self, condition):
        """Hear messages until a condition holds and give its value; fail if it never does.

        It does not hold as long as it looks at a message that has not come yet.
        """
        deadline = time.monotonic() + PATIENCE
        while True:
            with contextlib.suppress(LookupError):
                if value := condition():
                    return value
            assert time.monotonic() < deadline, "it did not come true"
            self._executor.spin_once(timeout_sec=0.05)

    def command(self, message):
        """Publish a command to a drill that is there to hear it."""
        publisher = self._commands[type(message)]
        self.until(publisher.get_subscription_count)
        publisher.publish(message)

    def call(self, kind, name, request):
        """Call a service of another node."""
        future = self.call_async(kind, name, request)
        # The middleware drops a response to a client that the server's side does not know yet.
        asked_again = time.monotonic() + UNANSWERED
        self.until(lambda: future.done() or time.monotonic() > asked_again)
        if not future.done():
            future = self.call_async(kind, name, request)
            self.until(future.done)
        return future.result()

    def call_async(self, kind, name, request):
        """Call a service of another node and give the future of its response."""
        return self.service(kind, name).call_async(request)

    def service(self, kind, name):
        """Give the client of a service that is there."""
        if name not in self._services:
            self._services[name] = self.node.create_client(kind, name)
        self.until(self._services[name].service_is_ready)
        return self._services[name]

    def step(self, seconds):
        """Let a paused drill go on; give the stamp that it reached [ns]."""
        request = StepSimulation.Request(duration=duration(seconds))
        response = self.call(StepSimulation, "simulation/step", request)
        assert response.result.result == Result.RESULT_OK, response.result.error_message
        return nanoseconds(response.time)

    def set_state(self, state):
        """Play, pause or stop; give the result."""
        request = SetSimulationState.Request(state=SimulationState(state=state))
        return self.call(SetSimulationState, "simulation/set_state", request).result

    def reset(self, scope=ResetSimulation.Request.SCOPE_ALL, seed=None):
        """Begin again; give the result."""
        request = ResetSimulation.Request(scope=scope, reseed=seed is not None, seed=seed or 0)
        return self.call(ResetSimulation, "simulation/reset", request).result

    def begin(self, seed=None):
        """Reset a drill to time zero, and wait until its status says that it is paused there."""
        self.set_state(SimulationState.STATE_PAUSED)
        assert self.reset(seed=seed).result == Result.RESULT_OK
        self.until(
            lambda: (
                self.status
                and self.status[-1].state == Status.STATE_PAUSED
                and stamps(self.status[-1:])[0] == 0
            )
        )

    def at(self, stamp):
        """Give the status of a simulation time."""
        self.until(lambda: stamps(self.status[-1:]) == [stamp])
        return self.status[-1]

    def change(self, transition, node="drill_node"):
        """Ask for a transition of the life cycle; give whether it was made."""
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.call(ChangeState, f"{node}/change_state", request).success

    def set_each(self, **values):
        """Set parameters of the drill one by one; give the results."""
        request = SetParameters.Request(parameters=parameters(values))
        return self.call(SetParameters, "drill_node/set_parameters", request).results

    def engage(self, data):
        """Put the drill into the rock, or out of it; give the response."""
        return self.call(SetBool, "engage", SetBool.Request(data=data))

    def inject(self, kind, channel="", magnitude=float("nan"), seconds=0.0):
        """Inject a fault; give the response."""
        fault = Fault(kind=kind, channel=channel, magnitude=magnitude)
        request = InjectFault.Request(fault=fault, duration=duration(seconds))
        return self.call(InjectFault, "inject_fault", request)


def parameters(values):
    """Give numbers, texts and booleans as parameters of ROS."""
    kinds = {
        float: (ParameterType.PARAMETER_DOUBLE, "double_value"),
        str: (ParameterType.PARAMETER_STRING, "string_value"),
        bool: (ParameterType.PARAMETER_BOOL, "bool_value"),
    }
    return [
        Parameter(name=name, value=ParameterValue(type=kind, **{field: value}))
        for name, value in values.items()
        for kind, field in [kinds[type(value)]]
    ]


def end(drill, recorder=None):
    """Interrupt a drill and then its recorder, which end well."""
    for process in filter(None, (drill, recorder)):
        process.interrupt()
        assert process.wait() == 0, process.output


def duration(seconds):
    """Give a builtin_interfaces/Duration."""
    whole, rest = divmod(round(seconds * SECOND), SECOND)
    return Duration(sec=whole, nanosec=rest)


def nanoseconds(time):
    """Give a builtin_interfaces/Time in nanoseconds."""
    return time.sec * SECOND + time.nanosec


def stamps(messages):
    """Give the stamps of messages in nanoseconds."""
    return [nanoseconds(message.header.stamp) for message in messages]


def steps(values):
    """Give the differences of values that follow each other."""
    return [after - before for before, after in itertools.pairwise(values)]
