"""What the wheels of ROS find in their environment without env.bash."""

import os
import subprocess
import sys

import pytest

from rpud_sim.ros.loopback import complete_environment
from rpud_sim.testing.processes import loopback_environment

WHEELS = {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"}


@pytest.fixture
def prefix(tmp_path):
    profile = tmp_path / "share/rpud_sim/config/fastdds_loopback.xml"
    profile.parent.mkdir(parents=True)
    profile.touch()
    return str(tmp_path)


def completed(prefix, **variables):
    environment = WHEELS | variables
    complete_environment(environment, prefix)
    return {name: value for name, value in environment.items() if name not in WHEELS}


LOCALHOST = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
MINE = {"FASTRTPS_DEFAULT_PROFILES_FILE": "mine.xml"}


@pytest.mark.parametrize(
    ("variables", "added"),
    [
        ({}, None),
        (LOCALHOST, None),
        # What the user has said stays.
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, {}),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"} | MINE, {}),
        # Beside another profile or implementation, the range is this machine.
        (MINE, LOCALHOST),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, LOCALHOST),
    ],
)
def test_the_wheels_use_loopback_alone_unless_the_user_has_said_otherwise(prefix, variables, added):
    if added is None:
        profile = f"{prefix}/share/rpud_sim/config/fastdds_loopback.xml"
        added = {
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
            "FASTRTPS_DEFAULT_PROFILES_FILE": profile,
        }
    assert completed(prefix, **variables) == {"AMENT_PREFIX_PATH": prefix} | variables | added


def test_the_start_of_ros_completes_the_environment_and_an_import_leaves_it():
    script = """
import os
before = dict(os.environ)
import rpud_sim.ros.client
assert dict(os.environ) == before
from rpud_sim.ros.process import start_ros
start_ros()
print(os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'])
"""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("ROS_", "FASTRTPS_"))}
    output = subprocess.check_output([sys.executable, "-c", script], env=environment | WHEELS)
    assert output.decode().strip() == "LOCALHOST"  # the profile lies in the clone, not in .venv


def test_a_profile_that_is_not_there_does_not_replace_the_range(prefix):
    """With SYSTEM_DEFAULT and no profile, Fast DDS would use every network interface."""
    gone = {"FASTRTPS_DEFAULT_PROFILES_FILE": "/nowhere/fastdds_loopback.xml"}
    assert completed(prefix, **gone)["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert loopback_environment(7, gone)["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_the_drill_of_a_test_and_a_program_without_env_bash_find_each_other(prefix):
    names = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE")
    ours = completed(prefix)
    theirs = loopback_environment(7, {"AMENT_PREFIX_PATH": prefix})
    assert [ours[name] for name in names] == [theirs[name] for name in names]
