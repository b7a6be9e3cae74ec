"""A plain rclpy client of the drill, as somebody else would write it."""

import itertools
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from rpud_msgs.msg import (
    ContactForce,
    DrillTool,
    Drive,
    NodalPlane,
    ReactingForce,
    Status,
    Trajectory,
    Waveform,
    WeightOnBit,
)
from sensor_msgs.msg import JointState

SECOND = 1_000_000_000
TYPES = {
    "nodal_plane": NodalPlane,
    "drill_tool": DrillTool,
    "reacting_force": ReactingForce,
    "contact_force": ContactForce,
    "wrench": WrenchStamped,
    "joint_states": JointState,
    "waveform": Waveform,
    "trajectory": Trajectory,
    "status": Status,
    "/diagnostics": DiagnosticArray,
    "/clock": Clock,
}
TELEMETRY = ("nodal_plane", "drill_tool", "reacting_force", "wrench", "joint_states")
PLENTY = QoSProfile(depth=5000)  # reliable, and longer than anything that a test waits for
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Client:
    """A node in a context of its own, which hears topics and gives commands."""

    def __init__(self, namespace="/rpud"):
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node("client", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._commands = {
            WeightOnBit: self.node.create_publisher(WeightOnBit, "command/weight_on_bit", 100),
            Drive: self.node.create_publisher(Drive, "command/drive", 100),
        }

    def close(self):
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def listen(self, topic, qos=PLENTY):
        """Give the list that the messages of a topic are added to."""
        heard = []
        qos = LATCHED if topic == "status" else qos
        self.node.create_subscription(TYPES[topic], topic, heard.append, qos)
        return heard

    def until(self, condition, seconds=30.0):
        """Hear messages until a condition holds and give its value; fail where it does not come."""
        deadline = time.monotonic() + seconds
        while not (value := condition()):
            assert time.monotonic() < deadline, "it did not come true"
            self._executor.spin_once(timeout_sec=0.05)
        return value

    def command(self, message):
        """Publish a command to a drill that is there to hear it."""
        publisher = self._commands[type(message)]
        self.until(publisher.get_subscription_count)
        publisher.publish(message)

    def call(self, kind, name, request):
        """Call a service of another node."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        return future.result()


def nanoseconds(time):
    """Give a builtin_interfaces/Time in nanoseconds."""
    return time.sec * SECOND + time.nanosec


def stamps(messages):
    """Give the stamps of messages in nanoseconds."""
    return [nanoseconds(message.header.stamp) for message in messages]


def steps(values):
    """Give the differences of values that follow each other."""
    return [after - before for before, after in itertools.pairwise(values)]
