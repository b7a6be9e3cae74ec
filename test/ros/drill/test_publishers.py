"""What a drill has published: numbers tell what was missed, and the journal is kept."""

import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from support import until

from rpud_sim.ros.drill.publishers import DrillPublishers, JournalStore
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run


def test_a_dropped_subscriber_knows_what_it_missed_by_the_numbers(drill_node, nodes):
    nodes.append(rclpy.create_node("listener", namespace="/rpud"))
    executor = SingleThreadedExecutor()
    executor.add_node(nodes[-1])
    publishers = DrillPublishers(drill_node, publish_clock=True)
    run = Run(Plan(Beginning(Settings())), wanted=lambda topic: topic in publishers.wanted)
    run.begin(0)
    numbers = []

    def spin_until(condition):
        until(lambda: condition() or executor.spin_once(timeout_sec=0.05))

    def go_on(blocks):
        for _ in range(blocks):
            publishers.look()
            publishers.publish(run.advance_to(run.next_boundary))

    def note(_, information):
        numbers.append(information["publication_sequence_number"])

    def subscribe():
        subscription = nodes[-1].create_subscription(JointState, "joint_states", note, 100)
        spin_until(lambda: "joint_states" not in publishers.own.unsubscribed)
        spin_until(subscription.get_publisher_count)
        return subscription

    go_on(3)
    subscription = subscribe()
    go_on(5)
    spin_until(lambda: len(numbers) == 5)
    nodes[-1].destroy_subscription(subscription)
    spin_until(lambda: "joint_states" in publishers.own.unsubscribed)
    go_on(7)
    subscribe()
    go_on(1)
    spin_until(lambda: len(numbers) == 6)
    assert numbers == [1, 2, 3, 4, 5, 13]
    executor.shutdown()
    publishers.destroy()


def stored(count, **most):
    store = JournalStore(**most)
    for number in range(count):
        store.add(b"entry %d" % number)
    return store


def numbers(entries):
    return [int(data.split()[1]) for _, data in entries]


def test_all_entries_are_read_page_by_page():
    before = time.time_ns()
    store = stored(1234)
    found, pages = [], 0
    while page := store.read(len(found)):
        assert len(page) <= 1000
        found += page
        pages += 1
    assert numbers(found) == list(range(1234))
    times = [published for published, _ in found]
    assert times == sorted(times)
    assert before <= times[0] <= times[-1] <= time.time_ns()
    assert pages == 3
    assert numbers(store.read(499)) == [499]
    assert numbers(store.read(1200)) == list(range(1200, 1234))


def test_the_oldest_are_dropped_and_counted():
    store = stored(2600, most=1000)
    assert (store.count, store.first_kept) == (2600, 1500)
    assert numbers(store.read(0)) == list(range(1500, 2000))
    assert numbers(store.read(2500)) == list(range(2500, 2600))
    assert store.read(2600) == store.read(2**64 - 1) == []
