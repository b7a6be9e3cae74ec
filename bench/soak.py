"""A drill for a long time under an independent listener: memory, pace, and every message."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.stats import linregress, theilslopes

from bench.bare_timer import LATE, PRIORITY, BareTimer
from bench.table import Row, row
from bench.talk import Talk, ros

SECONDS = 1800.0
_GROWTH = 1024.0  # of memory within the second half of the run: over 30 minutes, 4 MiB/h [KiB]
_PACE = 500.0  # how far the real-time factor may be from one [ppm]
_FITTED = 1000  # samples that the slope is fitted to; it compares each with each


def soak(seconds: float = SECONDS) -> Iterator[Row]:
    """Drill at the default rates, then end the drill."""
    with ros(), Talk({}) as talk, contextlib.ExitStack() as stack:
        processors = sorted(os.sched_getaffinity(0))
        timers = [stack.enter_context(BareTimer(PRIORITY, each)) for each in processors]
        talk.settle()
        times, sizes, pairs = list[float](), list[float](), list[tuple[int, int]]()
        began = time.monotonic()
        while time.monotonic() - began < seconds:
            talk.hearing.soonest = None
            talk.listen(1.0)
            times.append(time.monotonic())
            sizes.append(talk.memory())
            pairs += [talk.hearing.soonest] if talk.hearing.soonest else []
        values = talk.diagnostics()
        # Messages are taken meanwhile: a timer may wait long for its own processor.
        with ThreadPoolExecutor() as pool:
            ended = pool.map(lambda each: each.end(), timers)
            code = talk.end()
        bare = max(each[LATE] for each in ended)
    what = "soak: growth of memory in the second half"
    yield row(what, growth(times, sizes), "KiB", most=_GROWTH)
    apart = 1e6 * (pace(pairs) - 1.0)
    yield row("soak: real-time factor less one", apart, "ppm", least=-_PACE, most=_PACE)
    yield row("soak: wakes of a bare timer late by half a period, worst processor", bare)
    # Where the machine lets nobody run, both are late.
    most = 2.0 * bare + 1.0
    yield row("soak: blocks late by a period", int(values["deadlines_missed"]), most=most)
    yield row("soak: messages dropped by the node", int(values["messages_dropped"]), most=0)
    missing = sum(each.missing for each in talk.hearing.gaps.values())
    yield row("soak: messages missing", missing, most=0)
    yield row("soak: messages received", sum(talk.hearing.messages.values()), least=1)
    # The status counts an impact when it begins, the message comes when it has ended.
    counted, heard = (talk.hearing.last(name) for name in ("status", "contact_force"))
    yield row("soak: impacts not received", counted.impacts - heard.sequence - 1, least=0, most=1)
    yield row("soak: exit code", code, least=0, most=0)


def growth(times: Sequence[float], sizes: Sequence[float]) -> float:
    """Return the least growth [KiB] within the second half that its samples permit.

    It is the lower end of the interval of 95 % (slope by Theil and Sen), infinite for fewer than
    ten samples.
    """
    half = np.searchsorted(times, (times[0] + times[-1]) / 2) if len(times) else 0
    instants, kilobytes = np.asarray(times[half:], float), np.asarray(sizes[half:], float)
    if len(instants) < 10:
        return np.inf
    step = -(-len(instants) // _FITTED)
    instants, kilobytes = instants[::step], kilobytes[::step]
    slope = theilslopes(kilobytes, instants, 0.95).low_slope
    return float((instants[-1] - instants[0]) * slope)


def pace(pairs: Sequence[tuple[int, int]]) -> float:
    """Return simulated over elapsed time, from stamps and arrivals of messages that came soon."""
    if len(pairs) < 3:
        return np.nan
    # Counted from the first, as epoch nanoseconds are too long for a float.
    stamp, arrival = pairs[0]
    counted = np.array([(s - stamp, a - arrival) for s, a in pairs], float)
    return float(linregress(counted[:, 1], counted[:, 0]).slope)
