"""What the drill says arrives, or the numbers of its messages tell what was missed."""

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rpud_msgs.msg import ContactForce
from sensor_msgs.msg import JointState
from support import until

from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.topics import TOPICS

PLENTY = QoSProfile(depth=5000)


class Drill:
    """A run, its publishers, and their subscriber in the same process."""

    def __init__(self, node, listener):
        self.node, self.listener = node, listener
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(listener)
        self.outputs = DrillPublishers(node, publish_clock=True)
        self.run = Run(Beginning(Settings()), wanted=self.outputs.wanted)
        self.run.begin(0)

    def until(self, condition):
        until(lambda: condition() or self.executor.spin_once(timeout_sec=0.05))

    def go_on(self, blocks):
        for _ in range(blocks):
            self.outputs.publish(self.run.advance_to(self.run.next_boundary))


@pytest.fixture
def drill(nodes):
    nodes += [rclpy.create_node("drill_node"), rclpy.create_node("listener")]
    made = Drill(*nodes)
    yield made
    made.executor.shutdown()
    made.outputs.destroy()


def test_a_dropped_subscriber_knows_what_it_missed_by_the_numbers(drill):
    numbers = []

    def note(_, information):
        numbers.append(information["publication_sequence_number"])

    def subscribe():
        subscription = drill.listener.create_subscription(JointState, "joint_states", note, PLENTY)
        drill.until(lambda: "joint_states" not in drill.outputs.outlets.unheard)
        drill.until(subscription.get_publisher_count)
        return subscription

    drill.go_on(3)
    subscription = subscribe()
    drill.go_on(5)
    drill.until(lambda: len(numbers) == 5)
    drill.listener.destroy_subscription(subscription)
    drill.until(lambda: "joint_states" in drill.outputs.outlets.unheard)
    drill.go_on(7)
    subscribe()
    drill.go_on(1)
    drill.until(lambda: len(numbers) == 6)
    assert numbers == [1, 2, 3, 4, 5, 13]


def test_patient_publishers_lose_nothing_that_a_slow_listener_wants(drill):
    depth = TOPICS["contact_force"].depth
    heard, plenty = [], QoSProfile(depth=10 * depth)
    drill.listener.create_subscription(ContactForce, "contact_force", heard.append, plenty)
    drill.until(lambda: "contact_force" not in drill.outputs.outlets.unheard)
    drill.outputs.patient = True
    while drill.run.simulation.impact_count < 1.5 * depth:  # as fast as it goes
        drill.go_on(50)
    drill.outputs.outlets.wait(10.0)
    # It has not been asked for any of them until now.
    sent = drill.outputs.published["contact_force"]
    assert sent > depth
    drill.until(lambda: len(heard) == sent)
    assert [message.sequence for message in heard] == list(range(sent))
