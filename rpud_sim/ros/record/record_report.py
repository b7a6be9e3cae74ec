"""What a recorder says of itself: while it records, and at its end."""

from __future__ import annotations

import time
from collections.abc import Mapping

from rpud_sim.bag import BagWriter
from rpud_sim.bag.losses import Losses
from rpud_sim.ros.record.recorder_node import Recorder
from rpud_sim.terminal import printable

_PERIOD = 1.0  # s


class RecordProgress:
    """Gives the text of a progress line, once a second."""

    def __init__(self) -> None:
        self._began = self._shown = time.monotonic()
        self._count = 0
        self._size = 0

    @property
    def is_due(self) -> bool:
        """Whether a second has passed."""
        return time.monotonic() >= self._shown + _PERIOD

    def text(self, count: int, size: int, losses: Mapping[str, Losses], paused: bool) -> str:
        """Tell of `count` messages and `size` bytes so far, and of both since the last text."""
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
    """Tell what was recorded, what was lost, and what was left out."""
    files = f" in {bag.file_count} files" if bag.file_count > 1 else ""
    lines = [
        f"recorded {bag.message_count} messages on {node.topic_count} topics in {seconds:.1f} s "
        f"({bag.size / 1e6:.2f} MB{files}) to {bag.path}"
    ]
    for name, losses in sorted(node.losses.items()):
        if losses.total is None:
            lines.append(f"losses on {name} are unknown: the middleware does not number messages")
        elif losses.total:
            lines.append(
                f"lost {losses.total} messages on {name}: {losses.transport} on the way, "
                f"{losses.queue} as the disk was too slow"
            )
    lines += [f"not recorded: {name}: {reason}" for name, reason in sorted(node.skipped.items())]
    return "\n".join(map(printable, lines))
