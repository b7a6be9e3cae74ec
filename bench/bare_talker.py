"""Publishes a drill's messages again and again, as fast as listeners take them, by rclpy alone.

The messages are those of a second of drilling, made beforehand. So this is what bounds any node in
Python: a loop that publishes what is ready, with the same QoS and the same patience.
"""

from __future__ import annotations

import contextlib

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from rpud_sim.ros.drill.messages import filled
from rpud_sim.ros.drill.publishers import TOPICS
from rpud_sim.simulation.block import boundary
from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.telemetry import Telemetry

_PATIENCE = 1.0  # [s]
_PARAMETERS = {"weight_on_bit": 60.0, "sample_rate": 50_000, "telemetry_rate": 100}


def main() -> None:
    """Publish until SIGINT."""
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.init()
        node = rclpy.create_node("bare_talker")
        values = {
            name: node.declare_parameter(name, value).value for name, value in _PARAMETERS.items()
        }
        _talk(node, float(values["weight_on_bit"]), values["telemetry_rate"], values["sample_rate"])


def _talk(node: Node, weight_on_bit: float, telemetry_rate: int, sample_rate: int) -> None:
    telemetry = Telemetry(telemetry_rate, sample_rate)
    simulation = Simulation(to_configuration({"weight_on_bit": weight_on_bit}))
    messages = [
        (name, filled(TOPICS[name][0](), fields))
        for number in range(1, telemetry_rate + 1)
        for _, name, fields in telemetry.take(
            simulation.advance_to(boundary(number, telemetry_rate)), ()
        )
    ]
    publishers = {
        name: node.create_publisher(TOPICS[name][0], name, TOPICS[name][1]) for name, _ in messages
    }
    unacknowledged = dict.fromkeys(publishers, 0)
    while True:
        for name, message in messages:
            publisher = publishers[name]
            publisher.publish(message)
            unacknowledged[name] += 1
            if unacknowledged[name] >= TOPICS[name][1].depth:
                for each in publishers.values():
                    each.wait_for_all_acked(Duration(seconds=_PATIENCE))
                unacknowledged = dict.fromkeys(publishers, 0)


if __name__ == "__main__":
    main()
