"""The wheels of `make dist`, in an environment that has ROS as wheels and nothing of the clone."""

import ast
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from email import message_from_bytes
from pathlib import Path
from xml.etree import ElementTree

import pytest
from support import PATIENCE

ROOT = Path(__file__).resolve().parents[2]
VENV = Path(sys.prefix)
VERSION = ElementTree.parse(ROOT / "package.xml").getroot().findtext("version")

pytestmark = [
    pytest.mark.skipif(
        not (VENV / "share" / "rclpy").is_dir(), reason="the wheels stand beside those of ROS"
    ),
    pytest.mark.extended,
]


def variables():
    """Give the environment of a shell that has sourced nothing, and the domain of the tests."""
    kept = ("HOME", "LANG", "ROS_DOMAIN_ID", "ROS_LOG_DIR", "ROS_PYTHON_CHECK_FIELDS")
    own = {name: os.environ[name] for name in kept if name in os.environ}
    return {**own, "PATH": os.defpath, "PYTHONUNBUFFERED": "1"}


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """Build both wheels for this Python."""
    folder = tmp_path_factory.mktemp("dist")
    words = ("-m", "toolchain.dist", "--python", sys.executable, "--out", folder)
    subprocess.run([sys.executable, *words], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return folder


@pytest.fixture(scope="module")
def prefix(tmp_path_factory, wheels):
    """Install both wheels by pip into a new environment, beside links to all that they need.

    The links lie where pip would put the files. To install ROS again would take most of a minute.
    """
    prefix = tmp_path_factory.mktemp("environment")
    venv.create(prefix, symlinks=True)
    site_packages = Path(sysconfig.get_path("purelib")).relative_to(VENV)
    for place in (site_packages, Path("lib"), Path("share")):
        (prefix / place).mkdir(exist_ok=True)
        for entry in (VENV / place).iterdir():
            link = prefix / place / entry.name
            if not entry.name.startswith(("rpud", "python3")) and not link.exists():
                link.symlink_to(entry)
    # pip writes these two itself, and must not write into .venv.
    pip = (sys.executable, "-m", "pip", "--python", prefix, "install", "--quiet", "--no-index")
    words = ("--no-deps", "--disable-pip-version-check", *wheels.glob("*.whl"))
    subprocess.run([*pip, *words], check=True, env=variables())
    return prefix


@pytest.fixture
def call(prefix, tmp_path):
    """Run a program of the environment to its end, in a new folder; give what it printed."""

    def run(program, *words):
        done = subprocess.run(
            [prefix / "bin" / program, *words],
            cwd=tmp_path,
            env=variables(),
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done

    return run


def metadata_of(wheel):
    """Give the metadata of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (each for each in archive.namelist() if each.endswith(".dist-info/METADATA"))
        return message_from_bytes(archive.read(name))


def test_one_wheel_of_each_package_has_the_version_of_package_xml(wheels):
    found = {
        metadata_of(wheel)["Name"]: metadata_of(wheel)["Version"] for wheel in wheels.iterdir()
    }
    assert found == {"rpud_sim": VERSION, "rpud_msgs": VERSION}


def test_the_wheels_hold_no_path_of_this_machine(wheels):
    places = [str(each).encode() for each in (ROOT, VENV, VENV.resolve())]
    for wheel in wheels.iterdir():
        with zipfile.ZipFile(wheel) as archive:
            for name in archive.namelist():
                # A kernel is Numba's pickle, which names the files of Numba; assertions of the
                # libraries that colcon builds name their sources.
                if name.endswith(".kernel") or "/data/lib/" in name:
                    continue
                content = archive.read(name)
                assert not [place for place in places if place in content], name


def test_the_drill_runs_is_recorded_and_proved_without_an_environment(call, tmp_path):
    done = call("rpud", "run", "--duration", "0.5", "--record", "bag", "--quiet")
    assert "drilled 0.50 s" in done.stdout
    assert "compil" not in done.stderr
    assert "proved" in call("rpud", "verify", "bag").stdout


def test_messages_have_their_definitions_and_cross_dds(call):
    """One process publishes a message of this package to itself, by loopback alone."""
    output = call("python", "-c", SELF_TALK).stdout
    assert ast.literal_eval(output) == {"force": 12.5, "addresses": ["127.0.0.1"]}


SELF_TALK = """
import os, re, socket, rclpy
from pathlib import Path
from ament_index_python import get_resource
from rpud_msgs.msg import WeightOnBit
from rpud_sim.ros.process import start_ros
start_ros()
assert "msg/WeightOnBit.msg" in get_resource("rosidl_interfaces", "rpud_msgs")[0]
node = rclpy.create_node("talker")
heard = []
node.create_subscription(WeightOnBit, "force", heard.append, 10)
publisher = node.create_publisher(WeightOnBit, "force", 10)
while not heard:
    publisher.publish(WeightOnBit(force=12.5))
    rclpy.spin_once(node, timeout_sec=0.1)
own = [os.readlink(entry) for entry in Path("/proc/self/fd").iterdir() if entry.is_symlink()]
inodes = {link[8:-1] for link in own if link.startswith("socket:")}
lines = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
words = {line[1].partition(":")[0] for line in lines if line[9] in inodes}
addresses = [socket.inet_ntoa(bytes.fromhex(word)[::-1]) for word in sorted(words)]
print({"force": heard[0].force, "addresses": addresses})
"""
