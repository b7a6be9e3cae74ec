"""Client of a running drill: commands, services, topics and what they answer."""

from rpud_sim.ros.client.drill_client import DrillClient
from rpud_sim.ros.client.errors import (
    ClientError,
    NoAnswerError,
    NoDrillError,
    RefusedError,
)

__all__ = ["ClientError", "DrillClient", "NoAnswerError", "NoDrillError", "RefusedError"]
