"""Commands of a client: weight on bit, drive, feed, engagement and parameters."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rpud_msgs.msg import Drive, Feed, Status, WeightOnBit
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.client.arguments import to_number
from rpud_sim.ros.client.client_part import ClientPart
from rpud_sim.ros.client.errors import RefusedError


class Commands(ClientPart):
    """Commands of a client; each returns when the drill has accepted it."""

    def press(self, force: float) -> None:
        """Command a weight on bit [N]."""
        force = to_number("force", force)
        self._drill.command("weight_on_bit", WeightOnBit(force=force))

    def drive(
        self, enabled: bool = True, voltage: float | None = None, frequency: float | None = None
    ) -> None:
        """Command amplitude [V] and frequency [Hz], None as they are, or switch the drive off."""
        status = self.status
        present = (status.drive_voltage, status.drive_frequency) if enabled else (0.0, 0.0)
        message = Drive(
            enabled=bool(enabled),
            voltage=present[0] if voltage is None else to_number("voltage", voltage),
            frequency=present[1] if frequency is None else to_number("frequency", frequency),
        )
        self._drill.command("drive", message)

    def feed(self, rate: float | None = None, position: float | None = None) -> None:
        """Command the feed of a drill on an arm: its rate or its position, and not both.

        The rate is toward the rock [m/s], where zero holds the mount; the position is along the
        drill axis [m].
        """
        if (rate is None) == (position is None):
            raise ParameterError("feed takes a rate or a position")
        if rate is not None:
            message = Feed(mode=Feed.MODE_RATE, value=to_number("rate", rate))
        else:
            message = Feed(mode=Feed.MODE_POSITION, value=to_number("position", position))
        self._drill.command("feed", message)

    def engage(self, on: bool = True) -> None:
        """Put the drill tool into the rock, or take it out."""
        response = self._drill.call("engage", SetBool.Request(data=bool(on)), repeat=True)
        if not response.success:
            raise RefusedError(response.message)
        regime = Status.REGIME_DRILLING if on else Status.REGIME_FREE
        self._drill.until(lambda: self.status.regime == regime, f"no status said {regime}")

    def set_parameters(self, **values: Any) -> None:
        """Set parameters of the drill, all of them or none."""
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        request = SetParametersAtomically.Request(
            parameters=[parameter.to_parameter_msg() for parameter in parameters]
        )
        name = "set_parameters_atomically"
        result = self._drill.call_node(name, SetParametersAtomically, request).result
        if not result.successful:
            raise RefusedError(result.reason)
