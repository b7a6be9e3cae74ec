"""Client of a running drill: commands, services, topics; its errors end in one line."""

from rpud_sim.ros.client.drill_client import DrillClient
from rpud_sim.ros.client.listening_node import (
    ClientError,
    NoAnswerError,
    NoDrillError,
    RefusedError,
)

__all__ = ["ClientError", "DrillClient", "NoAnswerError", "NoDrillError", "RefusedError"]
