"""Process of ROS: its start, its orderly stop at a signal, and a limit for its end."""

from __future__ import annotations

import faulthandler
import os
import select
import signal
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any
from xml.etree import ElementTree

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from rpud_sim.foundation.user_files import named_errors, open_file
from rpud_sim.ros.environment import StartError, check_before_start
from rpud_sim.ros.loopback import complete_environment

LONGEST_END = 20.0  # of a node that has stopped, on a busy machine too [s]
_WITHOUT_LOG = ("--ros-args", "--disable-external-lib-logs")
_WHEEL = "ros-fastrtps"
_NOT_SENT = "failed to send response (timeout)"  # a warning of rclpy


def start_ros(
    arguments: Sequence[str] = (),
    context: rclpy.Context | None = None,
    domain_id: int | None = None,
) -> None:
    """Initialize rclpy, without signal handlers of its own, or raise a StartError.

    Where ROS cannot write its log file it writes none, with a warning.
    """
    complete_environment(os.environ)
    check_before_start(os.environ, domain_id)
    # Without a keystore, rcl would start all the same, and everything would be sent in the clear.
    if os.environ.get("ROS_SECURITY_ENABLE") == "true" and not _has_security():
        raise StartError(
            "ROS_SECURITY_ENABLE is true, but the ROS wheels are built without DDS-Security: "
            "use an installed ROS, or unset ROS_SECURITY_ENABLE"
        )
    for word, file in pairwise(arguments):
        if word == "--params-file" and os.path.exists(file):
            with named_errors(file, StartError):
                open_file(file).close()  # rcl would wait for a writer to a FIFO
    try:
        remove_ros_args(list(arguments))  # rclpy.init would print a second line
    except RuntimeError as error:  # RCLError
        reason = str(error).partition(", at ")[0]
        raise StartError(f"ROS arguments that cannot be used: {reason}") from error
    unwritable = _why_no_log(os.environ)
    try:
        rclpy.init(
            args=[*arguments, *(_WITHOUT_LOG if unwritable else ())],
            context=context,
            domain_id=domain_id,
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except RuntimeError as error:  # RCLError
        raise StartError(f"ROS cannot start: {' '.join(str(error).split())}") from error
    if unwritable:
        get_logger("rpud_sim").warning(f"no log file: {unwritable}; ROS_LOG_DIR names a folder")


def _why_no_log(environment: Mapping[str, str]) -> str:
    """Return why ROS cannot write to its log folder, which is made; empty if it can."""
    home, own = environment.get("HOME"), environment.get("ROS_HOME")
    folder = environment.get("ROS_LOG_DIR") or (own and f"{own}/log") or (home and "~/.ros/log")
    if not folder or (folder.startswith("~") and not home):
        return "HOME is not set"
    path = Path(f"{home}{folder[1:]}" if folder.startswith("~") else folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return f"{path}: {error.strerror}"
    return "" if os.access(path, os.W_OK | os.X_OK) else f"{path} cannot be written"


@contextmanager
def running_ros(arguments: Sequence[str] = ()) -> Iterator[None]:
    """Start ROS, and shut it down at the end; wrong names and parameters are StartErrors."""
    shown = warnings.showwarning
    warnings.showwarning = partial(_show_warning, shown)
    try:
        start_ros(arguments)
        yield
    except NameValidationException as error:
        raise name_error(error) from error
    except ParameterException as error:
        raise StartError(str(error)) from error
    finally:
        rclpy.try_shutdown()
        warnings.showwarning = shown


def _show_warning(others: Callable[..., object], message: Warning | str, *place: Any) -> None:
    """Show a warning; one of rclpy about a client that has gone is a line of the log."""
    if str(message).startswith(_NOT_SENT):
        get_logger("rpud_sim").warning("a client did not take its response: it may have ended")
    else:
        others(message, *place)


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


class StopRequest:
    """Request to stop the program; while it is entered, SIGINT, SIGTERM and SIGHUP make it.

    rclpy's own handlers would end the context while messages are still to be taken. A pipe
    carries the request, for a signal handler must not lock. ``with_parent`` also stops with the
    parent process.
    """

    def __init__(self, with_parent: bool = False) -> None:
        self._parent = os.getppid() if with_parent else None
        self._requested = False
        self._reading, self._writing = os.pipe()
        os.set_blocking(self._writing, False)
        self._handlers: dict[int, object] = {}

    def __enter__(self) -> StopRequest:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number == signal.SIGHUP and signal.getsignal(number) == signal.SIG_IGN:
                continue
            self._handlers[number] = signal.signal(number, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        self._requested = True  # so that no thread writes to what is closed
        os.close(self._reading)
        os.close(self._writing)

    @property
    def requested(self) -> bool:
        return self._requested or self.orphaned

    @property
    def orphaned(self) -> bool:
        """Whether the parent process has ended, which this one ends with."""
        # Polled: a signal of the kernel would come at the end of the parent's thread already.
        return self._parent not in (None, os.getppid())

    def request(self) -> None:
        if not self._requested:
            self._requested = True
            os.write(self._writing, b"\0")

    def wait(self, seconds: float) -> bool:
        """Sleep for some seconds or until the stop is requested; return whether it is."""
        if not self.requested:
            select.select([self._reading], [], [], max(0.0, seconds))
        return self.requested

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.request()


def limit_end() -> None:
    """End the process in 20 s at the latest, with the stacks of its threads and exit code 1.

    A killed process may hold a lock of the middleware in shared memory.
    """
    faulthandler.dump_traceback_later(LONGEST_END, exit=True)


@contextmanager
def limited_end() -> Iterator[None]:
    """Limit an end as ``limit_end`` does, in a process that continues after it."""
    limit_end()
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


# Joint and link of urdf/rpud_feed.urdf for each model.
_FEED = ("rpud_feed", "rpud_rail")
_ROTATION = ("rpud_rotation", "rpud_bit")


def robot_description(
    folder: Path, feed: bool = False, rotation: bool = False, prefix: str = ""
) -> str:
    """Return the URDF of the drill with the joints of the models that are on.

    Names of its links and joints begin with the prefix.
    """
    text = (folder / "rpud.urdf").read_text(encoding="utf-8")
    if not (feed or rotation or prefix):
        return text
    robot = ElementTree.fromstring(text)
    wanted = {*(_FEED if feed else ()), *(_ROTATION if rotation else ())}
    more = ElementTree.fromstring((folder / "rpud_feed.urdf").read_text(encoding="utf-8"))
    robot.extend(part for part in more if part.get("name") in wanted)
    for part in (*robot.findall("link"), *robot.findall("joint")):
        part.set("name", prefix + part.get("name", ""))
        for end in (*part.findall("parent"), *part.findall("child")):
            end.set("link", prefix + end.get("link", ""))
    return ElementTree.tostring(robot, encoding="unicode")
