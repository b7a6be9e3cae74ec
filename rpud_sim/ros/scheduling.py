"""Scheduling of threads that have deadlines."""

from __future__ import annotations

import os


def schedule_thread(priority: int) -> str:
    """Schedule the calling thread with a priority; return how it is scheduled now.

    What it starts does not inherit that. If the system denies it, the thread stays as it is. The
    priority is of SCHED_FIFO, from 1 to 99; 0 for time-sharing.
    """
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK if priority else os.SCHED_OTHER
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except OSError as error:
        return f"time-sharing: real-time priority {priority}: {error.strerror}"
    return f"real-time priority {priority}" if priority else "time-sharing"
