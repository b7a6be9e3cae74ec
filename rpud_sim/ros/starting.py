"""Start of ROS in a process."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from rpud_sim.foundation.quantities import ExpectedError
from rpud_sim.ros.environment import complete_environment

_WHEEL = "ros-fastrtps"


class StartError(ExpectedError, RuntimeError):
    """Start of ROS that is not possible as requested; the message is one line."""

    code = 2


def start_ros(
    arguments: Sequence[str] = (),
    context: rclpy.Context | None = None,
    domain_id: int | None = None,
) -> None:
    """Initialize rclpy without signal handlers of its own: `StopRequest` has them.

    It completes the environment of the process first.
    It raises a StartError where rcl cannot start with the arguments, or DDS-Security is requested
    and Fast DDS lacks it.
    """
    complete_environment(os.environ)
    # Without a keystore, rcl would start all the same, and everything would be sent in the clear.
    if os.environ.get("ROS_SECURITY_ENABLE") == "true" and not _has_security():
        raise StartError(
            "ROS_SECURITY_ENABLE is true, but the ROS wheels are built without DDS-Security: "
            "use an installed ROS, or unset ROS_SECURITY_ENABLE"
        )
    try:
        remove_ros_args(list(arguments))  # rclpy.init would print a second line
    except RuntimeError as error:  # RCLError
        reason = str(error).partition(", at ")[0]
        raise StartError(f"ROS arguments that cannot be used: {reason}") from error
    try:
        rclpy.init(
            args=list(arguments),
            context=context,
            domain_id=domain_id,
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except RuntimeError as error:  # RCLError
        raise StartError(f"ROS cannot start: {' '.join(str(error).split())}") from error


@contextmanager
def running_ros(arguments: Sequence[str] = ()) -> Iterator[None]:
    """Start ROS, and shut it down at the end of the context.

    A name that ROS does not allow, and a parameter of rclpy with another type, are StartErrors.
    """
    try:
        start_ros(arguments)
        yield
    except NameValidationException as error:
        raise name_error(error) from error
    except ParameterException as error:
        raise StartError(str(error)) from error
    finally:
        rclpy.try_shutdown()


def name_error(error: NameValidationException) -> StartError:
    """Return the error of a name that ROS does not allow, as one line."""
    what, name, *_ = str(error).splitlines()  # below them it points at the character
    return StartError(f"{what} {name.strip()}")


def _has_security() -> bool:
    """Return False for the wheels; an installed ROS has DDS-Security."""
    try:
        metadata.version(_WHEEL)
    except metadata.PackageNotFoundError:
        return True
    return False
