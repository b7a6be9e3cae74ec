"""A subscriber that has ended or is stopped is told from one that is slow, whatever runs it."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy
from std_msgs.msg import Header
from support import until

from rpud_sim.ros.graph import has_lost_subscriber

SUBSCRIBER = """
import rclpy
from std_msgs.msg import Header
rclpy.init()
node = rclpy.create_node("subscriber")
node.create_subscription(Header, "/followed", print, 10)
rclpy.spin(node)
"""


@pytest.fixture
def publisher(nodes):
    nodes.append(rclpy.create_node("publisher"))
    nodes[0].create_publisher(Header, "/followed", 10)
    return nodes[0]


def follow(process, publisher, *before):
    follower = process(*before, sys.executable, "-c", SUBSCRIBER)
    until(lambda: publisher.count_subscribers("/followed"))
    return follower


def test_one_that_is_stopped_and_one_that_is_killed_are_lost(process, publisher):
    follower = follow(process, publisher)
    assert not has_lost_subscriber(publisher, "/followed")
    follower.send(signal.SIGSTOP)
    until(lambda: has_lost_subscriber(publisher, "/followed"))
    follower.send(signal.SIGCONT)
    until(lambda: not has_lost_subscriber(publisher, "/followed"))
    follower.kill()
    until(lambda: has_lost_subscriber(publisher, "/followed"))


def test_one_in_a_container_has_a_number_of_its_own_and_is_not_lost(process, publisher):
    # The second process has a number there that none has here.
    here = {int(entry.name) for entry in Path("/proc").glob("[0-9]*")}
    number = next(n for n in range(32_000, 1, -1) if n not in here)
    begin = f'echo {number - 1} > /proc/sys/kernel/ns_last_pid && "$@"'
    words = ("unshare", "--pid", "--fork", "--kill-child", "--mount-proc", "sh", "-c", begin, "sh")
    if subprocess.run((*words, "true"), check=False, capture_output=True).returncode:
        pytest.skip("this user may not make a namespace of processes")
    follow(process, publisher, *words)
    assert not has_lost_subscriber(publisher, "/followed")
