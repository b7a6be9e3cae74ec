"""What the drill says arrives: block by block, with faults where there are some, and in time."""

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import ContactForce, Faults
from sensor_msgs.msg import JointState
from support import until

from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.topics import TOPICS

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
ORIGIN = 1_700_000_000 * SECOND
PLENTY = QoSProfile(depth=5000)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def nanoseconds(stamp):
    return stamp.sec * SECOND + stamp.nanosec


class Drill:
    """A run, its publishers, and their subscriber in the same process."""

    def __init__(self, node, listener):
        self.node, self.listener = node, listener
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(listener)
        self.outputs = DrillPublishers(node, publish_clock=True)
        self.begin(ORIGIN)

    def begin(self, origin):
        self.run = Run(Beginning(Settings()), wanted=self.outputs.wanted)
        self.run.begin(origin)

    def hear(self, kind, topic, qos=PLENTY):
        heard = []
        subscription = self.listener.create_subscription(kind, topic, heard.append, qos)
        self.until(subscription.get_publisher_count)
        self.until(lambda: self.node.count_subscribers(topic))
        return heard

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


def test_faults_are_published_when_they_change_and_to_subscribers_that_come_later(drill):
    early = drill.hear(Faults, "faults", LATCHED)
    drill.go_on(2)
    drill.run.simulation.inject(Fault("lost_preload"))
    for _ in range(2):
        drill.outputs.publish(drill.run.changes())
    drill.until(lambda: len(early) == 2)
    assert [len(message.faults) for message in early] == [0, 1]
    late = drill.hear(Faults, "faults", LATCHED)
    drill.until(lambda: late)
    assert late == early[1:]
    # With another origin the same faults have other stamps.
    drill.run.place(0)
    drill.outputs.publish(drill.run.changes())
    drill.until(lambda: len(early) == 3)
    assert nanoseconds(early[2].header.stamp) == 20 * MILLISECOND
    assert nanoseconds(early[1].faults[0].onset) == ORIGIN + 20 * MILLISECOND
    assert nanoseconds(early[2].faults[0].onset) == 20 * MILLISECOND
    drill.begin(2 * ORIGIN // 3)  # another run publishes its own
    drill.go_on(1)
    drill.until(lambda: len(early) == 4)
    assert nanoseconds(early[3].header.stamp) - 2 * ORIGIN // 3 in (0, 10 * MILLISECOND)


def test_patient_publishers_lose_nothing_that_a_slow_listener_wants(drill):
    depth = TOPICS["contact_force"].depth
    heard = drill.hear(ContactForce, "contact_force", QoSProfile(depth=10 * depth))
    drill.outputs.patient = True
    while drill.run.simulation.impact_count < 1.5 * depth:  # as fast as it goes
        drill.go_on(50)
    drill.outputs.outlets.wait(10.0)
    # It has not been asked for any of them until now.
    sent = drill.outputs.published["contact_force"]
    assert sent > depth
    drill.until(lambda: len(heard) == sent)
    assert [message.sequence for message in heard] == list(range(sent))
