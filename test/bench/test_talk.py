"""What a talk hears is of its own process."""

import sys

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bench.talk import Talk
from rpud_sim.ros.drill.publishers import DIAGNOSTICS, qos_of

SLEEPING = (sys.executable, "-c", "import time; time.sleep(100)")


@pytest.fixture(autouse=True)
def ros():
    rclpy.init()
    yield
    rclpy.try_shutdown()


def test_the_diagnostics_of_another_drill_are_not_taken_for_its_own():
    with Talk(SLEEPING, {}) as talk:
        publisher = talk.node.create_publisher(DiagnosticArray, "/diagnostics", qos_of(DIAGNOSTICS))
        assert talk.hearing.take_until(publisher.get_subscription_count, 30.0)

        def send(namespace, blocks):
            status = DiagnosticStatus(name=f"{namespace}/drill_node: timing")
            status.values = [KeyValue(key="blocks", value=blocks)]
            publisher.publish(DiagnosticArray(status=[status]))

        send("/other", "2")
        assert talk.hearing.take_until(lambda: talk.hearing.messages["/diagnostics"] == 1, 30.0)
        send(talk.namespace, "1")
        assert talk.diagnostics() == {"blocks": "1"}
