"""A name that a process of this machine holds is known without discovery."""

import os
import signal
import subprocess
import sys

import pytest
import rclpy

from rpud_sim.ros.drill.drill_node import DrillNode
from rpud_sim.ros.drill.namesakes import NameHold, Namesakes, NamesakeSearch

NAME = "/a_namespace/a_node"
LONG_NAME = "/" + "/".join(["a_long_part_of_a_namespace"] * 8) + "/a_node"
HOLDER = f"""
import rclpy
from rpud_sim.ros.drill.namesakes import NameHold
rclpy.init()
hold = NameHold({NAME!r})
print(hold.taken, flush=True)
input()
"""


@pytest.fixture(autouse=True)
def ros():
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture
def holder():
    command = [sys.executable, "-c", HOLDER]
    with subprocess.Popen(command, stdin=-1, stdout=-1, text=True) as process:
        try:
            assert process.stdout.readline() == "False\n"
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("name", [NAME, LONG_NAME])
def test_a_name_is_held_once_until_it_is_released(name):
    first = NameHold(name)
    second = NameHold(name)
    assert (first.taken, second.taken) == (False, True)
    second.release()  # it holds nothing: the first still does
    assert NameHold(name).taken
    first.release()
    third = NameHold(name)
    assert not third.taken
    third.release()


def test_another_name_or_another_domain_is_no_hindrance(holder):
    other = NameHold(f"{NAME}_2")
    assert not other.taken
    other.release()
    rclpy.shutdown()
    rclpy.init(domain_id=int(os.environ["ROS_DOMAIN_ID"]) ^ 1)
    elsewhere = NameHold(NAME)
    assert not elsewhere.taken
    elsewhere.release()


def test_a_frozen_process_keeps_its_name_and_a_killed_one_does_not(holder):
    holder.send_signal(signal.SIGSTOP)
    assert NameHold(NAME).taken
    holder.kill()
    holder.wait()
    hold = NameHold(NAME)
    assert not hold.taken
    hold.release()


def test_a_drill_is_found_although_discovery_has_no_time(monkeypatch):
    monkeypatch.setattr("rpud_sim.ros.drill.namesakes._DISCOVERY", 0.0)
    drill = DrillNode(namespace="/twin")
    search = NamesakeSearch("drill_node", "twin")
    assert search.finish()
    search.close()
    drill.destroy_node()
    search = NamesakeSearch("drill_node", "twin")
    assert not search.finish()
    search.close()


def test_of_two_that_search_at_the_same_time_one_finds_the_other():
    first = NamesakeSearch("drill_node", "twin")
    second = NamesakeSearch("drill_node", "twin")
    assert (first.finish(), second.finish()) == (False, True)
    first.close()
    second.close()


def test_a_system_without_such_sockets_leaves_it_to_discovery(monkeypatch):
    monkeypatch.setattr("sys.platform", "darwin")
    assert not NameHold(NAME).taken
    assert not NameHold(NAME).taken


def test_nodes_of_one_process_may_share_a_name():
    node = rclpy.create_node("a_node", namespace="/a_namespace")
    first, second = Namesakes(node), Namesakes(node)
    first.close()
    second.close()
    node.destroy_node()
