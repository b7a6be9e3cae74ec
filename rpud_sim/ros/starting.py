"""The start of ROS in a process, or one line that says why it cannot start."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib import metadata

import rclpy
from rclpy.signals import SignalHandlerOptions

_WHEEL = "ros-fastrtps"


class StartError(RuntimeError):
    """ROS cannot start as it is requested; the message is one line."""


def start_ros(arguments: Sequence[str] = ()) -> None:
    """Initialize rclpy without signal handlers of its own: `StopRequest` has them.

    Args:
        arguments: command line with ROS arguments.

    Raises:
        StartError: if rcl refuses to start, or if DDS-Security is requested and Fast DDS lacks it.
    """
    # Without a keystore, rcl would start all the same, and everything would be sent in the clear.
    if os.environ.get("ROS_SECURITY_ENABLE") == "true" and not _has_security():
        raise StartError(
            "ROS_SECURITY_ENABLE is true, but the ROS wheels are built without DDS-Security: "
            "use an installed ROS, or unset ROS_SECURITY_ENABLE"
        )
    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # RCLError
        raise StartError(f"ROS cannot start: {' '.join(str(error).split())}") from error


def _has_security() -> bool:
    """Return False for the wheels; an installed ROS has DDS-Security."""
    try:
        metadata.version(_WHEEL)
    except metadata.PackageNotFoundError:
        return True
    return False
