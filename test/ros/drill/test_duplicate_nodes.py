"""A name that a process of this machine holds is known without discovery."""

import signal
import subprocess
import sys

import pytest
import rclpy

from rpud_sim.ros.drill.drill_node import open_drill
from rpud_sim.ros.drill.managed_node import NameHold
from rpud_sim.ros.environment import StartError

NAME = "/a_namespace/a_node"
DOMAIN = 7
LONG_NAME = "/" + "/".join(["a_long_part_of_a_namespace"] * 8) + "/a_node"
HOLDER = f"""
from rpud_sim.ros.drill.managed_node import NameHold
hold = NameHold({NAME!r}, {DOMAIN})
print(hold.taken, flush=True)
input()
"""


def taken(name=NAME, domain=DOMAIN):
    hold = NameHold(name, domain)
    hold.release()  # where it is taken it holds nothing, and the other still does
    return hold.taken


@pytest.mark.parametrize("name", [NAME, LONG_NAME])
def test_a_name_is_held_once_until_it_is_released(name):
    hold = NameHold(name, DOMAIN)
    assert (hold.taken, taken(name), taken(name)) == (False, True, True)
    assert not taken(f"{name}_2")
    assert not taken(name, DOMAIN + 1)
    hold.release()
    assert not taken(name)


def test_a_frozen_process_keeps_its_name_and_a_killed_one_does_not():
    command = [sys.executable, "-c", HOLDER]
    with subprocess.Popen(command, stdin=-1, stdout=-1, text=True) as process:
        assert process.stdout.readline() == "False\n"
        process.send_signal(signal.SIGSTOP)
        assert taken()
        process.kill()
        process.wait()
        assert not taken()


@pytest.mark.parametrize("namespace", ["twin", "/twin/a"])
def test_a_second_drill_of_a_name_is_refused_unless_that_is_allowed(namespace):
    with open_drill({}, namespace) as first:
        name = first.get_fully_qualified_name()
        hold = NameHold(name, first.context.get_domain_id())
        assert hold.taken
        first.destroy_node()
    context = rclpy.Context()
    rclpy.init(context=context)
    hold = NameHold(name, context.get_domain_id())
    rclpy.shutdown(context=context)
    with pytest.raises(StartError, match=f"a drill named {name} runs already"):
        open_drill({}, namespace).__enter__()
    with open_drill({}, namespace, allow_duplicate=True) as second:
        second.destroy_node()
    hold.release()
