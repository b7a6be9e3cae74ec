"""Real-time scheduling of a thread, where the system permits it."""

from __future__ import annotations

import os


def schedule_thread(priority: int) -> str:
    """Let the calling thread go before all of lower priority; tell how it is scheduled now.

    What it starts is not scheduled so. A system that does not permit it leaves the thread as it is.

    Args:
        priority: of real-time scheduling (SCHED_FIFO), from 1 to 99; 0 for time-sharing.
    """
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK if priority else os.SCHED_OTHER
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except OSError as error:
        return f"time-sharing: real-time priority {priority}: {error.strerror}"
    return f"real-time priority {priority}" if priority else "time-sharing"
