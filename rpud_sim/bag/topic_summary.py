"""Summary of a topic: its type, its number of messages and their times."""

from __future__ import annotations

from dataclasses import dataclass

from rpud_sim.bag.losses import Losses
from rpud_sim.bag.metadata import Topic

# Fewer messages have no rate: two that arrive together would have one of many kHz.
RATE_MESSAGES = 10


@dataclass(frozen=True)
class TopicSummary:
    """Content of a bag, or of one file, for one topic."""

    # name, type and offered quality of service; of the first channel if several differ
    topic: Topic
    message_count: int  # messages of the topic
    # log time of the first message [ns]; None without messages or without an index
    first_time: int | None
    last_time: int | None  # log time of the last message [ns]; None as for ``first_time``
    definition: str | None  # ``ros2msg`` text of the type; None if the file lacks it
    losses: Losses | None = None  # messages that the recorder lost; None if they were not counted
    # encoding, type and definition without comments, of all channels
    kinds: frozenset[tuple[str, str, str]] = frozenset()

    @property
    def rate(self) -> float | None:
        """Mean rate from the first to the last message [Hz].

        None if there are fewer than ``RATE_MESSAGES``, or their times are unknown or equal.
        """
        if self.first_time is None or self.last_time is None:
            return None
        if self.message_count < RATE_MESSAGES or self.last_time <= self.first_time:
            return None
        return (self.message_count - 1) * 1e9 / (self.last_time - self.first_time)
