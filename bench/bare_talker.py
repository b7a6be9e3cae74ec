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

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.drill.messages import filled
from rpud_sim.ros.drill.publishers import qos_of
from rpud_sim.ros.types import message_class
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.topics import TOPICS

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
    settings = to_settings(
        {
            "weight_on_bit": weight_on_bit,
            "telemetry_rate": telemetry_rate,
            "sample_rate": sample_rate,
        }
    )
    messages = [
        (name, filled(message_class(TOPICS[name].type)(), fields))
        for _, name, fields in Run(Beginning(settings)).advance_to(SECOND)
    ]
    publishers = {
        name: node.create_publisher(type(message), name, qos_of(TOPICS[name]))
        for name, message in messages
    }
    unacknowledged = dict.fromkeys(publishers, 0)
    while True:
        for name, message in messages:
            publisher = publishers[name]
            publisher.publish(message)
            unacknowledged[name] += 1
            if unacknowledged[name] >= TOPICS[name].depth:
                try:
                    for each in publishers.values():
                        each.wait_for_all_acked(Duration(seconds=_PATIENCE))
                except RuntimeError:  # RCLError, where a signal came meanwhile
                    if rclpy.ok():
                        raise
                    return
                unacknowledged = dict.fromkeys(publishers, 0)


if __name__ == "__main__":
    main()
