"""Executors whose nodes survive what strangers send."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.executors import Executor

_LONGEST_WAIT = 0.1  # for something to do [s]


def serve(executor: Executor, failed: Callable[[str], None]) -> None:
    """Do the next work of an executor's nodes, or return after 0.1 s without any.

    rclpy itself raises for some messages, such as a ``/clock`` before time zero: such an error is
    reported, and ends nothing.

    Args:
        executor: of the nodes.
        failed: called with one line where the work raised an error.
    """
    try:
        executor.spin_once(timeout_sec=_LONGEST_WAIT)
    except Exception as error:
        failed(raised(error))


def raised(error: Exception) -> str:
    """Describe an error that something from the network has raised, in one line."""
    return f"it raised {type(error).__name__}: {' '.join(str(error).split())}"
