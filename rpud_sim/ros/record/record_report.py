"""Texts of a recorder: progress while it records, and a summary at its end."""

from __future__ import annotations

import time
from collections.abc import Mapping

from rpud_sim.bag import BagWriter
from rpud_sim.bag.losses import Losses
from rpud_sim.foundation.quantities import suggestion
from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.record.recorder_node import Recorder

_PERIOD = 1.0  # s


class RecordProgress:
    """Progress of a recording, as one line a second."""

    def __init__(self) -> None:
        self._began = self._shown = time.monotonic()
        self._count = 0
        self._size = 0

    @property
    def is_due(self) -> bool:
        """Whether a second has passed since the last text."""
        return time.monotonic() >= self._shown + _PERIOD

    def text(self, count: int, size: int, losses: Mapping[str, Losses], paused: bool) -> str:
        """Return the progress so far, with rates since the last text; ``size`` in bytes."""
        now = time.monotonic()
        period = max(now - self._shown, 1e-9)
        parts = [
            f"{now - self._began:.0f} s",
            f"{count} messages",
            f"{(count - self._count) / period:.0f}/s",
            f"{size / 1e6:.2f} MB",
            f"{(size - self._size) / period / 1e6:.2f} MB/s",
            f"{sum(item.total or 0 for item in losses.values())} lost",
            *(["paused"] if paused else []),
        ]
        self._shown, self._count, self._size = now, count, size
        return ", ".join(parts)


def summary(node: Recorder, bag: BagWriter, seconds: float) -> str:
    """Return the summary of a recording that took that long [s]: recorded, lost, left out."""
    files = f" in {bag.file_count} files" if bag.file_count > 1 else ""
    lines = [
        f"recorded {bag.message_count} messages on {node.topic_count} topics in {seconds:.1f} s "
        f"({bag.size / 1e6:.2f} MB{files}) to {bag.path}"
    ]
    for name, losses in sorted(node.losses.items()):
        if losses.total is None:
            lines.append(f"losses on {name} are unknown: the middleware does not number messages")
        if losses.total != 0 and losses != Losses(None):
            lines.append(lost_text(name, losses))
    lines += [
        f"subscribed {name} again {count} times, in case a publisher was not heard"
        for name, count in sorted(node.renewals.items())
    ]
    if node.guard.count:
        lines.append(f"{node.guard.count} things that arrived could not be used; the log names one")
    lines += [f"not recorded: {name}: {reason}" for name, reason in sorted(node.skipped.items())]
    return "\n".join(map(printable, lines))


def lost_text(name: str, losses: Losses) -> str:
    parts = {
        "on the way": losses.transport,
        "for which the queue (--max-cache-size) had no room": losses.queue,
        "damaged": losses.damaged,
    }
    known = {what: count for what, count in parts.items() if count}
    causes = ", ".join(f"{count} {what}" for what, count in known.items())
    return f"lost {sum(known.values())} messages on {name}: {causes}"


def late_text(exposure: float, max_loss: float) -> str:
    """Return a warning if data reached the disk too late; empty if it did not.

    ``exposure`` is the longest time from the receipt of a message to the disk [s], ``max_loss`` the
    bound that was requested [s].
    """
    if exposure <= max_loss:
        return ""
    return (
        f"data was on the disk {exposure:.1f} s after it was received, {exposure - max_loss:.1f} s "
        f"later than --max-loss {max_loss:g} s allows: a crash might have cost as much"
    )


def failure(node: Recorder, *, allow_empty: bool) -> str:
    """Return why the bag is not as requested, in one line; empty if it is."""
    reasons = []
    known = [name for name, _ in node.get_topic_names_and_types()]
    if not allow_empty:
        if node.missing:
            named = (name + suggestion(name, known) for name in node.missing)
            reasons.append(f"never appeared: {', '.join(named)}")
        elif not node.taken:
            prefix = node.get_namespace()
            spaces = sorted({name.rpartition("/")[0] for name in known if name.count("/") > 1})
            hint = "" if node.topic_count else suggestion(prefix, spaces)
            reasons.append(f"nothing came on {node.topic_count} topics in {prefix}{hint}")
    if node.further_types:
        topics = ", ".join(node.further_types)
        reasons.append(f"topics with further types, which are not in the bag: {topics}")
    return "; ".join(reasons)
