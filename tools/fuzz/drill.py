"""A real drill under attack: its callbacks get real messages, as the executor would give them."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import rclpy
from rclpy.logging import LoggingSeverity, get_logger
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rpud_msgs.msg import CommandResult
from rpud_msgs.srv import SetSimulationState

from rpud_sim.ros.drill.drill_node import DrillNode
from rpud_sim.ros.threads import StoppedError
from rpud_sim.simulation.changes import Drive, WeightOnBit
from rpud_sim.simulation.configuration import CHANGEABLE

PLAYING = SetSimulationState.Request().state.STATE_PLAYING
OPTIONS = {
    "rock_model": "specific_energy",  # so that every fault is possible
    "actuator_model": "resonance",
    "command_timeout": 3600.0,  # so that stamps are looked at
    "telemetry_rate": 500,  # each input waits for the end of a block
}


class Drill:
    """A drill that plays in real time while it is attacked in another thread.

    Attributes:
        reasons: of the commands that were refused.

    Args:
        folder: for files.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = DrillNode(context=self._context, parameter_overrides=_given(OPTIONS))
        for logger in (self.node.get_logger(), get_logger("rcl_lifecycle"), get_logger("rcl")):
            logger.set_level(LoggingSeverity.FATAL)  # thousands of reasons
        self.reasons: list[str] = []
        inbox = self.node._inbox
        refuse = inbox.refuse

        def remember(result: CommandResult, reason: str) -> None:
            self.reasons.append(reason)
            refuse(result, reason)

        inbox.refuse = remember
        self._interval = sys.getswitchinterval()
        sys.setswitchinterval(1e-4)  # the attack must not keep the drill from its turn
        self.node.start()
        self.services = {
            service.srv_name.rsplit("drill_node/")[-1].removeprefix("/"): service
            for service in self.node.services
        }
        self.topics = {each.topic_name.removeprefix("/"): each for each in self.node.subscriptions}
        self._settings = self.node.settings

    def create_node(self, overrides: Mapping[str, Any]) -> Node:
        """Make another node, as a launch with these parameters would."""
        return Node("another", context=self._context, parameter_overrides=_given(overrides))

    def close(self) -> None:
        """End the drill."""
        self.node.stop()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)
        sys.setswitchinterval(self._interval)

    def command(self, topic: str, message: Any) -> None:
        """Give a command, as if it had come over DDS."""
        information = {"received_timestamp": time.time_ns(), "publication_sequence_number": None}
        self.topics[topic].callback(serialize_message(message), information)

    def call(self, name: str, request: Any) -> Any:
        """Call a service, as if the request had come over DDS."""
        service = self.services[name]
        return service.callback(request, service.srv_type.Response())

    def do(self, action: Callable[[Any], Any]) -> Any:
        """Have something done, or read, in the thread of the drill."""
        try:
            return self.node.loop.request(action)
        except StoppedError:
            raise AssertionError("the drilling has ended") from self.node.loop.failure

    def now(self) -> int:
        """The stamp of the present simulation time [ns]."""
        return self.do(lambda live: live.stamp)

    @property
    def rejected(self) -> int:
        """Commands that were refused."""
        return self.node._inbox.rejected

    @property
    def requests_refused(self) -> int:
        """Requests that were refused."""
        return self.node._inbox.requests_refused

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Let its time stand still, for what no drill does while it plays."""
        self.do(lambda live: live.timeline.pause())
        try:
            yield
        finally:
            self.do(lambda live: live.timeline.play())

    def state(self) -> tuple[Any, ...]:
        """All that a refused input must leave as it is."""

        def read(live: Any) -> tuple[Any, ...]:
            run = live.run
            simulation = run.simulation
            return (
                simulation.applied,
                simulation.configuration,
                simulation.faults.records,
                simulation.faults.forgotten,
                run.active,
                run.commands_lost,
                live.timeline.playing,
                live.timeline.at_start,
                live.timeline.goal,
            )

        parameters = self.node.get_parameters_by_prefix("")
        values = tuple((name, repr(each.value)) for name, each in sorted(parameters.items()))
        return (self.node.settings, values, *self.do(read))

    def sound(self) -> bool:
        """Whether what is in force is finite."""
        applied = self.do(lambda live: live.run.simulation.applied)
        numbers = (applied.weight_on_bit.force, applied.drive.voltage, applied.drive.frequency)
        return all(map(math.isfinite, numbers))

    def restore(self) -> None:
        """Take back what was accepted, so that every input meets the same drill."""
        if self.node.settings != self._settings:
            parameters = [Parameter(each, value=self._settings.value(each)) for each in CHANGEABLE]
            self.node.set_parameters_atomically(parameters)
        configuration = self._settings.configuration
        drive = Drive(
            True,
            configuration.actuator.nominal_voltage,
            configuration.parameters.vibration_frequency,
        )

        def act(live: Any) -> None:
            run = live.run
            run.simulation.clear()
            weight_on_bit = WeightOnBit(configuration.parameters.weight_on_bit)
            for command in (*self.node._inbox.drain(), weight_on_bit, drive):
                run.apply(command)
            run.watch()

        self.do(act)
        request = SetSimulationState.Request()
        request.state.state = PLAYING
        self.call("simulation/set_state", request)


def _given(overrides: Mapping[str, Any]) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in overrides.items()]
