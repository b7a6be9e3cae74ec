"""Serialized messages of one topic in one buffer, for work on all of them at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class MessageBlock:
    """Consecutive serialized messages of one topic.

    Attributes:
        topic: its name.
        log_times: when they were received [ns since the epoch], int64, shape (n,).
        publish_times: when they were sent [ns since the epoch], int64, shape (n,).
        data: bytes (CDR) of all messages, uint8; they may have other bytes between them.
        starts: where each message begins in ``data``, int64, shape (n,).
        sizes: of each message [bytes], int64, shape (n,).
    """

    topic: str
    log_times: np.ndarray
    publish_times: np.ndarray
    data: np.ndarray
    starts: np.ndarray
    sizes: np.ndarray

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.starts)

    def message(self, number: int) -> bytes:
        """Return the bytes of one message."""
        start = int(self.starts[number])
        return self.data[start : start + int(self.sizes[number])].tobytes()
