"""ROS starts, or a program says in one line why not, and leaves nothing behind."""

import os
import sys
from importlib import metadata
from pathlib import Path

import pytest

from rpud_sim.bag import BagWriter

SECURITY = {"ROS_SECURITY_ENABLE": "true"}


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / "empty"):
        pass
    return tmp_path / "empty"


def commands(bag):
    new = bag.parent / "new"
    return {
        "rpud run": ("rpud", "run", "--duration", "1", "--record", new),
        "drill_node": ("drill_node",),
        "rpud record": ("rpud", "record", "--out", new),
        "rpud replay": ("rpud", "replay", bag),
    }


def wheels_are_installed():
    try:
        return bool(metadata.version("ros-fastrtps"))
    except metadata.PackageNotFoundError:
        return False


@pytest.mark.extended
@pytest.mark.skipif(not wheels_are_installed(), reason="an installed ROS has DDS-Security")
@pytest.mark.parametrize("name", commands(Path()))
@pytest.mark.parametrize("keystore", [False, True], ids=["without_keystore", "with_keystore"])
def test_security_that_the_wheels_lack_is_refused_in_one_line(process, bag, name, keystore):
    environment = {**os.environ, **SECURITY}
    if keystore:
        (bag.parent / "keystore" / "enclaves").mkdir(parents=True)
        environment["ROS_SECURITY_KEYSTORE"] = str(bag.parent / "keystore")
    command = process(*commands(bag)[name], env=environment)
    assert command.wait() == 2
    assert command.output == (
        f"{name}: ROS_SECURITY_ENABLE is true, but the ROS wheels are built without DDS-Security: "
        "use an installed ROS, or unset ROS_SECURITY_ENABLE"
    )
    assert not (bag.parent / "new").exists()


def test_a_refusal_of_rcl_is_one_line(process):
    program = (
        "from rpud_sim.ros.starting import StartError, start_ros\n"
        "try:\n"
        "    start_ros()\n"
        "except StartError as error:\n"
        "    print(f'refused: {error}')\n"
    )
    environment = {**os.environ, "ROS_DOMAIN_ID": "no number"}
    refused = process(sys.executable, "-c", program, env=environment)
    assert refused.wait() == 0
    assert refused.output.startswith("refused: ROS cannot start: ")
    assert "\n" not in refused.output
