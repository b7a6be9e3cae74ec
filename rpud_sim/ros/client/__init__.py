"""Client of a running drill: commands, services, topics and what they answer.

What the drill refuses is a ``RefusedError`` with its reason, a missing or second drill a
``NoDrillError``, and anything that does not come in time a ``NoAnswerError``. An argument that
cannot be used is a ``ParameterError``, and a node or a name that ROS does not permit a
``StartError``.
"""

from rpud_sim.ros.client.drill_client import DrillClient
from rpud_sim.ros.client.listening_node import (
    ClientError,
    NoAnswerError,
    NoDrillError,
    RefusedError,
)

__all__ = ["ClientError", "DrillClient", "NoAnswerError", "NoDrillError", "RefusedError"]
