"""Executors whose nodes survive invalid messages from the network."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.executors import Executor

_LONGEST_WAIT = 0.1  # for a callback that is ready [s]


def serve(executor: Executor, failed: Callable[[str], None]) -> None:
    """Execute the next callback of an executor's nodes, or return after 0.1 s without any.

    rclpy itself raises errors at some messages, such as a ``/clock`` before time zero: without
    this, a stranger's message would end the program.

    Args:
        executor: of the nodes.
        failed: called with one line if the callback raised an error.
    """
    try:
        executor.spin_once(timeout_sec=_LONGEST_WAIT)
    except Exception as error:
        failed(raised(error))


def raised(error: Exception) -> str:
    """Return one line about an error that a message from the network has caused."""
    return f"it raised {type(error).__name__}: {' '.join(str(error).split())}"
