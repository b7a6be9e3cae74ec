"""Flies the supervisor against the real drill: faster than real time, and the same every time.

Everything here is public: executables, topics, services. To test other mission software, copy the
file, start that in place of ``supervisor.py``, and wait for its answer to each step.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import Fault, ReactingForce, Result, Status
from rpud_msgs.srv import InjectFault, ResetSimulation, StepSimulation

SUPERVISOR = Path(__file__).parent / "supervisor.py"
DOMAIN = int(os.environ.get("ROS_DOMAIN_ID", 0)) or 77  # one in which nothing else is
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
ENVIRONMENT = {
    **os.environ,
    "ROS_DOMAIN_ID": str(DOMAIN),
}
NAMESPACE = ("-r", "__ns:=/rpud")
DRILL = {
    "start_paused": "true",  # time stands still between our steps,
    "publish_clock": "true",  # and begins at zero
    "regime": "free",  # the supervisor engages
    "drive_enabled": "false",  # and drives
    "weight_on_bit": "0.0",
    "command_timeout": "0.5",
    "command_loss_ramp": "0.2",
}
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PERIOD = 0.1  # in which the supervisor gives two commands [s]


class Mission:
    """Steps the drill, and lets the supervisor answer before it steps again."""

    def __init__(self):
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=DOMAIN)
        self._node = rclpy.create_node("mission", namespace="/rpud", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._states = self._listen(DiagnosticArray, "supervisor/state", LATCHED)
        self._statuses = self._listen(Status, "status", LATCHED)
        self._forces = self._listen(ReactingForce, "reacting_force", 1000)
        self._clients = {}
        self.time = 0.0  # that was reached [s]
        self.commands = 0  # that the supervisor should have given

    def close(self):
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def until(self, condition, seconds=100.0):
        """Hear messages until a condition holds; the very first drill compiles for a minute."""
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, f"at {self.time} s: {self.states} {self.status}"
            self._executor.spin_once(timeout_sec=0.1)

    def call(self, kind, name, **request):
        """Call a service and give its response."""
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, name)
        client = self._clients[name]
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.until(future.done)
        return future.result()

    def step(self, seconds=PERIOD, answers=2):
        """Let the drill go on, and wait until it has the supervisor's commands, if any come."""
        nanoseconds = round(seconds * 1e9)
        duration = Duration(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        response = self.call(StepSimulation, "simulation/step", duration=duration)
        assert response.result.result == Result.RESULT_OK, response.result.error_message
        self.time = to_seconds(response.time)
        self.commands += answers
        self.until(lambda: self._forces and self._forces[-1].header.stamp == response.time)
        self.until(lambda: self.status.commands_accepted == self.commands)

    def step_until(self, state, most=100):
        """Step until the supervisor is in a state; fail if it takes too many steps."""
        for _ in range(most):
            if state in self.states:
                return
            self.step()
        raise AssertionError(f"not {state} after {most} steps: {self.states}")

    @property
    def status(self):
        """The drill's latest."""
        return self._statuses[-1] if self._statuses else None

    @property
    def states(self):
        """When the supervisor took which state [s]."""
        return {each.status[0].name: to_seconds(each.header.stamp) for each in self._states}

    @property
    def forces(self):
        """Every sample of the reacting force: time [s] and force [N]."""
        return [(to_seconds(each.header.stamp), each.force) for each in self._forces]

    def _listen(self, kind, name, qos):
        heard = []
        self._node.create_subscription(kind, name, heard.append, qos)
        return heard


def to_seconds(stamp):
    return stamp.sec + stamp.nanosec / 1e9


def end(process):
    process.send_signal(signal.SIGINT)
    try:
        process.wait(10.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def drill():
    """The drill, for all tests: starting it takes the longest."""
    parameters = [word for name, value in DRILL.items() for word in ("-p", f"{name}:={value}")]
    process = subprocess.Popen(
        ["drill_node", "--ros-args", *NAMESPACE, *parameters], env=ENVIRONMENT
    )
    yield process
    end(process)


@contextlib.contextmanager
def flight():
    """Begin a mission at time zero, and give it with a supervisor that has engaged."""
    mission = Mission()
    supervisor = None
    try:
        reset = mission.call(ResetSimulation, "simulation/reset")
        assert reset.result.result == Result.RESULT_OK, reset.result.error_message
        command = [sys.executable, SUPERVISOR, "--ros-args", *NAMESPACE]
        supervisor = subprocess.Popen(command, env=ENVIRONMENT)
        mission.until(lambda: "ramping" in mission.states)
        yield mission, supervisor
    finally:
        if supervisor:
            end(supervisor)
        mission.close()


def jam(mission):
    """Drill for a while, jam the free mass, and give what came of it."""
    mission.step_until("drilling")
    for _ in range(10):
        mission.step()
    begun = mission.time
    fault = Fault(kind=Fault.KIND_FREE_MASS_JAMMED)
    injected = mission.call(InjectFault, "inject_fault", fault=fault)
    assert injected.success, injected.message
    drilling = mission.status
    mission.step_until("retreated", most=10)
    return begun, drilling, mission.states, mission.forces


@pytest.mark.usefixtures("drill")
def test_it_drills_at_the_target_sees_the_jam_and_retreats_and_always_alike():
    with flight() as (mission, _):
        began, drilling, states, forces = jam(mission)
        retreated = mission.status

    assert list(states) == ["engaging", "ramping", "drilling", "retreating", "retreated"]
    assert drilling.regime == Status.REGIME_DRILLING
    assert drilling.drive_enabled
    held = [force for when, force in forces if states["drilling"] + 0.5 < when <= began]
    assert sum(held) / len(held) == pytest.approx(35.0, abs=2.0)

    assert began + 0.2 < states["retreating"] < began + 0.5
    assert states["retreated"] == pytest.approx(states["retreating"] + PERIOD)
    assert retreated.regime == Status.REGIME_FREE
    assert not retreated.drive_enabled
    assert retreated.weight_on_bit == 0.0

    with flight() as (mission, _):
        began_again, _, states_again, forces_again = jam(mission)
    assert (began_again, states_again) == (began, states)
    assert forces_again == forces  # to the last bit


@pytest.mark.usefixtures("drill")
def test_a_supervisor_that_dies_leaves_a_drill_that_makes_itself_safe():
    with flight() as (mission, supervisor):
        for _ in range(5):
            mission.step()
        supervisor.kill()
        mission.step(1.0, answers=0)
        mission.until(lambda: mission.status.commands_lost)
        assert mission.status.weight_on_bit == 0.0
        assert not mission.status.drive_enabled
