"""Part of a client: commands and services that belong together."""

from __future__ import annotations

from rpud_msgs.msg import Status

from rpud_sim.ros.client.drill_connection import DrillConnection


class ClientPart:
    """Part of a client, which uses the client's connection."""

    def __init__(self, drill: DrillConnection) -> None:
        self._drill = drill

    @property
    def status(self) -> Status:
        """Latest status of the drill, a ``rpud_msgs/Status``."""
        return self._drill.status
