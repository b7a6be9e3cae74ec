"""A name that a process of this machine holds is known without discovery."""

import errno
import signal
import socket
import subprocess
import sys

import pytest
import rclpy

from rpud_sim.ros.drill.drill_node import DrillNode
from rpud_sim.ros.drill.duplicate_nodes import DuplicateNodes, DuplicateSearch, NameHold

NAME = "/a_namespace/a_node"
DOMAIN = 7
LONG_NAME = "/" + "/".join(["a_long_part_of_a_namespace"] * 8) + "/a_node"
HOLDER = f"""
from rpud_sim.ros.drill.duplicate_nodes import NameHold
hold = NameHold({NAME!r}, {DOMAIN})
print(hold.taken, flush=True)
input()
"""


def assert_free(name, domain):
    hold = NameHold(name, domain)
    assert not hold.taken
    hold.release()


@pytest.fixture
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
    first = NameHold(name, DOMAIN)
    second = NameHold(name, DOMAIN)
    assert (first.taken, second.taken) == (False, True)
    second.release()  # it holds nothing: the first still does
    assert NameHold(name, DOMAIN).taken
    first.release()
    assert_free(name, DOMAIN)


def test_another_name_or_another_domain_is_no_hindrance(holder):
    assert_free(f"{NAME}_2", DOMAIN)
    assert_free(NAME, DOMAIN + 1)


def test_a_frozen_process_keeps_its_name_and_a_killed_one_does_not(holder):
    holder.send_signal(signal.SIGSTOP)
    assert NameHold(NAME, DOMAIN).taken
    holder.kill()
    holder.wait()
    assert_free(NAME, DOMAIN)


def test_a_drill_is_found_although_discovery_has_no_time(ros, monkeypatch):
    monkeypatch.setattr("rpud_sim.ros.drill.duplicate_nodes._DISCOVERY", 0.0)
    drill = DrillNode(namespace="/twin")
    search = DuplicateSearch("drill_node", "twin")
    assert search.finish()
    search.close()
    drill.destroy_node()
    search = DuplicateSearch("drill_node", "twin")
    assert not search.finish()
    search.close()


def test_of_two_that_search_at_the_same_time_one_finds_the_other(ros):
    first = DuplicateSearch("drill_node", "twin")
    second = DuplicateSearch("drill_node", "twin")
    assert (first.finish(), second.finish()) == (False, True)
    first.close()
    second.close()


def test_a_system_without_such_sockets_leaves_it_to_discovery(monkeypatch):
    monkeypatch.setattr("sys.platform", "darwin")
    assert not NameHold(NAME, DOMAIN).taken
    assert not NameHold(NAME, DOMAIN).taken


def test_nodes_of_one_process_may_share_a_name(ros):
    node = rclpy.create_node("a_node", namespace="/a_namespace")
    first, second = DuplicateNodes(node), DuplicateNodes(node)
    domain = node.context.get_domain_id()
    second.close()
    assert NameHold(NAME, domain).taken  # by the first
    first.close()
    assert_free(NAME, domain)
    node.destroy_node()


def test_where_such_sockets_are_forbidden_no_name_is_called_taken(monkeypatch):
    class Forbidden(socket.socket):
        def bind(self, address):
            raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(socket, "socket", Forbidden)
    assert not NameHold(NAME, DOMAIN).taken


def test_the_domain_is_that_of_the_node_s_own_context():
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = rclpy.create_node("a_node", namespace="/a_namespace", context=context)
    namesakes = DuplicateNodes(node)
    assert NameHold(NAME, DOMAIN).taken
    namesakes.close()
    node.destroy_node()
    rclpy.shutdown(context=context)
