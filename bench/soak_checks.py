"""What a long run is judged by: pure functions from what was seen to one verdict each."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.stats import linregress, theilslopes

MEMORY_BOUND = 1024.0  # growth within the second half of the run: over 30 minutes, 4 MiB/h [KiB]
REAL_TIME_BOUND = 0.0005  # how far the real-time factor may be from one
_FITTED = 1000  # samples that the slope is fitted to; it compares each with each


@dataclasses.dataclass(frozen=True)
class Verdict:
    """One line of the result.

    Args:
        name: what was looked at.
        found: what was found, with its unit.
        allowed: what would have been right.
        passed: whether it was.
    """

    name: str
    found: str
    allowed: str
    passed: bool


@dataclasses.dataclass
class Tally:
    """Counts messages whose numbers should follow each other, in constant memory."""

    messages: int = 0
    first: int = 0
    end: int = 0
    breaks: int = 0

    def add(self, number: int, length: int = 1) -> None:
        """Count a message that begins with a number and holds that many."""
        if self.messages == 0:
            self.first = number
        elif number != self.end:
            self.breaks += 1
        self.messages += 1
        self.end = number + length


def memory_growth(name: str, times: Sequence[float], sizes: Sequence[float]) -> Verdict:
    """Judge the growth of a process's memory over the second half of its run.

    Args:
        name: of the process.
        times: of the samples, ascending [s].
        sizes: resident memory then [KiB].

    Returns:
        Failed if even the lower end of the growth's 95 % interval (slope by Theil and Sen) exceeds
        ``MEMORY_BOUND``, or if there are fewer than ten samples to tell.
    """
    half = np.searchsorted(times, (times[0] + times[-1]) / 2) if len(times) else 0
    chosen = np.asarray(times[half:], float), np.asarray(sizes[half:], float)
    allowed = f"interval begins below {MEMORY_BOUND:g} KiB"
    name = f"{name}: growth of memory in the second half"
    if len(chosen[0]) < 10:
        return Verdict(name, f"only {len(chosen[0])} samples", allowed, False)
    step = -(-len(chosen[0]) // _FITTED)
    instants, kilobytes = (values[::step] for values in chosen)
    fit = theilslopes(kilobytes, instants, 0.95)
    span = instants[-1] - instants[0]
    low, growth, high = span * fit.low_slope, span * fit.slope, span * fit.high_slope
    found = f"{growth:.0f} KiB [{low:.0f}, {high:.0f}] of {kilobytes[-1] / 1024:.1f} MiB"
    return Verdict(name, found, allowed, bool(low <= MEMORY_BOUND))


def real_time(stamps: Sequence[int], arrivals: Sequence[int]) -> Verdict:
    """Judge simulated against elapsed time over the whole run.

    Args:
        stamps: one of each second's messages, the one that came soonest after its stamp [ns].
        arrivals: when these came, by a monotonic clock [ns].
    """
    name, allowed = "real-time factor", f"1 +- {REAL_TIME_BOUND:g}"
    if len(stamps) < 3 or arrivals[-1] == arrivals[0]:
        return Verdict(name, f"only {len(stamps)} seconds", allowed, False)
    # Counted from the first, as epoch nanoseconds are too long for a float.
    simulated = np.array([stamp - stamps[0] for stamp in stamps], float)
    elapsed = np.array([arrival - arrivals[0] for arrival in arrivals], float)
    factor = float(linregress(elapsed, simulated).slope)
    return Verdict(name, f"{factor:.6f}", allowed, abs(factor - 1.0) <= REAL_TIME_BOUND)


def deadlines(missed: int, blocks: int, loads: Sequence[float]) -> Verdict:
    """Judge the deadlines that the node says it missed, beside the machine's load averages."""
    found = f"{missed} of {blocks}, load average {np.mean(loads):.2f} (up to {max(loads):.2f})"
    return Verdict("deadlines missed", found, "0 on an idle machine", missed == 0)


def dropped(count: int) -> Verdict:
    """Judge the messages that the node could not hand to the middleware."""
    return Verdict("messages dropped by the node", str(count), "0", count == 0)


def telemetry(topic: str, tally: Tally, last: int) -> Verdict:
    """Judge a topic at the telemetry rate.

    Args:
        topic: its name.
        tally: of its samples, numbered by their stamps.
        last: number of the sample at the time of the node's last status.
    """
    due = last + 1 - tally.first
    found = f"{tally.messages} messages, {tally.breaks} gaps"
    passed = tally.messages == due > 0 and tally.breaks == 0
    return Verdict(f"{topic}: one message for each sample", found, f"{due} messages", passed)


def stream(topic: str, tally: Tally) -> Verdict:
    """Judge a stream whose messages say with which of its items they begin."""
    found = f"{tally.end - tally.first} items in {tally.messages} messages, {tally.breaks} gaps"
    passed = tally.messages > 0 and tally.breaks == 0
    return Verdict(f"{topic}: numbers follow each other", found, "no gap", passed)


def impacts(tally: Tally, counted: int) -> Verdict:
    """Judge the impacts heard against those that the node's last status counts.

    The status counts an impact when it begins, the message tells it when it has ended.
    """
    found = f"last number {tally.end - 1}, {tally.breaks} gaps"
    allowed = f"last of {counted}, or one in progress; no gap"
    passed = tally.messages > 0 and tally.breaks == 0 and 0 <= counted - tally.end <= 1
    return Verdict("contact_force: equal to status.impacts", found, allowed, passed)


def ended(name: str, code: int | None) -> Verdict:
    """Judge how a process ended: its exit code, None if it had to be killed."""
    found = "had to be killed" if code is None else f"exit {code}"
    return Verdict(f"{name}: ended when asked", found, "exit 0", code == 0)


def to_table(verdicts: Sequence[Verdict]) -> str:
    """Format verdicts as a Markdown table."""
    rows = [("", "figure", "found", "allowed"), ("---",) * 4]
    rows += [("ok" if v.passed else "FAILED", v.name, v.found, v.allowed) for v in verdicts]
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |"
        for row in rows
    ]
    return "\n".join(lines)
