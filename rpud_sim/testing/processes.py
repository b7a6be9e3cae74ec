"""Drill of a test, as a process in a ROS domain that no one else uses."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from rpud_sim.foundation.child_process import ChildProcess
from rpud_sim.ros.loopback import PROFILE, loopback_variables
from rpud_sim.testing.errors import DrillError
from rpud_sim.testing.guard import VARIABLE

# 101 is the last domain whose ports lie below those that Linux gives to outgoing connections.
_LAST_DOMAIN = 101
_DEFAULT_DOMAINS = (0, 42)  # of ROS, and of env.bash: people use them without a lock
_END = 3.0  # time for it to end [s]
_PARTICIPANTS = 8  # of another program that are looked for in a domain
_ELSEWHERE = ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
# Parameters of every drill of a test: time is paused between steps, and begins at zero.
LOCKSTEP: Mapping[str, bool] = {"start_paused": True, "publish_clock": True}

_GUARD = Path(__file__).with_name("guard.py")
NO_FAULTS = "faults: []\n"
# It loads what takes time, and has its arguments from a line of its input.
_PROGRAM = """
import shlex, sys
import rpud_sim.ros.drill.drill_node
from rpud_sim.cli.executables import drill_node
from rpud_sim.simulation import Settings, compile_kernels
compile_kernels(Settings().configuration)
sys.argv += shlex.split(sys.stdin.readline() or sys.exit())
drill_node()
"""


class DomainClaim:
    """ROS domain that is this process's own until it is released, or the process ends.

    An abstract socket keeps other test runs out: it is seen wherever the ports of the domain are,
    also by another user and with another temporary folder. Domains in which a program without one
    runs are passed over: its ports are open. If all domains are in use, it raises a DrillError.
    """

    def __init__(self) -> None:
        theirs = {*_DEFAULT_DOMAINS, *_environment_domain()}
        for domain in range(_LAST_DOMAIN, 0, -1):
            if domain in theirs:
                continue
            held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            with contextlib.suppress(OSError):  # another test run has it
                held.bind(f"\0rpud_sim domain {domain}")
                if _is_quiet(domain):
                    self.domain = domain
                    self._held = held
                    return
            held.close()
        raise DrillError("all ROS domains are in use")

    def release(self) -> None:
        self._held.close()


def loopback_environment(domain: int, environ: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the environment of ``env.bash``: ROS stays on loopback, in a domain."""
    prefixes = [*filter(None, environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]
    places = [Path(prefix, "share", "rpud_sim") for prefix in prefixes]
    places.append(Path(__file__).resolve().parents[2])  # a clone
    profile = next((place / PROFILE for place in places if (place / PROFILE).is_file()), None)
    environment = {name: value for name, value in environ.items() if name not in _ELSEWHERE}
    environment["ROS_DOMAIN_ID"] = str(domain)
    return environment | loopback_variables(environ, profile)


@contextlib.contextmanager
def applied(environment: Mapping[str, str]) -> Iterator[None]:
    """Give this process an environment for a while: ROS reads it when a context begins."""
    wanted = dict(environment)
    if "rclpy" in sys.modules and "FASTRTPS_DEFAULT_PROFILES_FILE" not in os.environ:
        # Fast DDS reads a profile only once, and has perhaps done so.
        wanted.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
        wanted["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    before = dict(os.environ)
    os.environ.clear()
    os.environ.update(wanted)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _environment_domain() -> tuple[int, ...]:
    given = os.environ.get("ROS_DOMAIN_ID", "")
    return (int(given),) if given.isdecimal() else ()


def _is_quiet(domain: int) -> bool:
    first = 7400 + 250 * domain
    unicast = range(first + 10, first + 10 + 2 * _PARTICIPANTS)
    return all(_is_free(port) for port in (first, *unicast))


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True


class DrillProcess:
    """Process of a drill node in a ROS domain that it claims: it imports, and waits for its start.

    It reads its scenario again at each reset: a file that the owner may write before. A guard ends
    all processes with its environment if this process is killed.
    """

    def __init__(self) -> None:
        self.namespace = ""  # of the node, from its start on
        self._ending = False
        self.folder = Path(tempfile.mkdtemp(prefix="rpud_drill_"))
        self._claim = DomainClaim()
        self.domain = self._claim.domain
        self.scenario = self.folder / "scenario.yaml"
        self.scenario.write_text(NO_FAULTS)
        self.environment = {
            **loopback_environment(self.domain),
            VARIABLE: str(self.folder / "log"),
            "PYTHONUNBUFFERED": "1",
        }
        self._guard = subprocess.Popen(
            [sys.executable, "-I", "-S", _GUARD, str(os.getpid()), str(self.folder)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self.process = ChildProcess(
            (sys.executable, "-c", _PROGRAM),
            environment={**self.environment, "OPENBLAS_NUM_THREADS": "1"},
            folder=self.folder,
            talked_to=True,
        )

    def start(self, parameters: Mapping[str, Any], namespace: str) -> None:
        """Start the node in lockstep, with these parameters."""
        self.namespace = namespace
        # A name, not the path: the journal has it, and is the same in every attempt.
        values = {**parameters, **LOCKSTEP, "scenario": self.scenario.name}
        file = self.folder / "parameters.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": _to_ros(values)}}))
        words = ("--ros-args", "-r", f"__ns:={namespace}", "--params-file", str(file))
        self.process.write_line(shlex.join(words))

    def interrupt(self) -> None:
        """Have it end, without a wait for that."""
        if not self._ending:  # a second signal would keep it from leaving the graph
            self._ending = True
            self.process.send(signal.SIGINT)

    def stop(self) -> None:
        """End it, and leave the domain to others."""
        self.interrupt()
        self.process.join(_END)
        self.process.kill()
        self._claim.release()
        shutil.rmtree(self.folder, ignore_errors=True)
        self._guard.kill()
        self._guard.wait()


def _to_ros(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters as the node declares them: every number is a floating-point number."""
    return {
        name: float(value) if isinstance(value, int) and not isinstance(value, bool) else value
        for name, value in values.items()
    }
