"""The drill's node in the process that made it."""

import time

import pytest
import rclpy

from rpud_sim.ros import drill_node
from rpud_sim.ros.publishers import DrillPublishers


@pytest.fixture
def node():
    rclpy.init()
    made = drill_node.DrillNode()
    yield made
    made.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.parametrize("long", [True, False])
def test_a_configuration_that_takes_long_says_why(node, monkeypatch, capfd, long):
    def compiling(parameters):
        deadline = time.monotonic() + 10.0
        while long and drill_node._COMPILING not in shown() and time.monotonic() < deadline:
            time.sleep(0.01)

    def shown():
        seen.append(capfd.readouterr().err)
        return "".join(seen)

    seen = []
    monkeypatch.setattr(drill_node, "compile_kernels", compiling)
    monkeypatch.setattr(drill_node, "_LONG", 0.01 if long else 3600.0)
    node.trigger_configure()
    node.trigger_cleanup()
    assert (drill_node._COMPILING in shown()) == long


def test_a_clean_up_is_no_end_of_the_process_however_long_its_listeners_take(node, monkeypatch):
    finished = []
    wait = DrillPublishers.wait_for_listeners

    def slowly(self, seconds):
        finished.append(node.finished)  # what the executor asks meanwhile
        wait(self, seconds)

    monkeypatch.setattr(DrillPublishers, "wait_for_listeners", slowly)
    node.start()
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert finished == [False]
