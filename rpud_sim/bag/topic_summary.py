"""Summary of a topic: its type, its number of messages and their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.losses import RECORD_NAME, Losses, losses_from_record
from rpud_sim.bag.metadata import Topic

if TYPE_CHECKING:
    from rpud_sim.bag.storage_files import StorageFile

RATE_MESSAGES = 10
"""Fewer messages have no rate: two that arrive together would have one of many kHz."""


@dataclass(frozen=True)
class TopicSummary:
    """Content of a bag, or of one file, for one topic.

    Attributes:
        topic: name, type and offered quality of service; of the first channel if several differ.
        message_count: messages of the topic.
        first_time: log time of the first message [ns]; None without messages or without an index.
        last_time: log time of the last message [ns]; None as for ``first_time``.
        definition: ``ros2msg`` text of the type; None if the file lacks it.
        losses: messages that the recorder lost; None if they were not counted.
        kinds: encoding, type and definition without comments, of all channels.
    """

    topic: Topic
    message_count: int
    first_time: int | None
    last_time: int | None
    definition: str | None
    losses: Losses | None = None
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


def summarize(
    files: Sequence[StorageFile],
) -> tuple[tuple[TopicSummary, ...], dict[str, BagFormatError]]:
    """Return the readable topics of a bag by name, and the errors of damaged ones.

    The errors also name the record of losses if it is damaged.
    """
    topics: list[TopicSummary] = []
    errors: dict[str, BagFormatError] = {}
    losses: dict[str, Losses] = {}
    try:
        for file in files:
            for record in file.records(RECORD_NAME):
                losses |= losses_from_record(record)
    except BagFormatError as error:
        errors[f"record {RECORD_NAME}"] = error
    for name in sorted({name for file in files for name in file.topic_channels}):
        try:
            parts = [file.topic(name) for file in files if name in file.topic_channels]
        except BagFormatError as error:
            errors[name] = error
        else:
            topics.append(_joined(parts, losses.get(name)))
    return tuple(topics), errors


def _joined(parts: Sequence[TopicSummary], losses: Losses | None) -> TopicSummary:
    """Return the summary of a topic from those of the files that hold it."""
    times = [time for part in parts for time in (part.first_time, part.last_time)]
    known = [time for time in times if time is not None]
    return TopicSummary(
        topic=parts[0].topic,
        message_count=sum(part.message_count for part in parts),
        first_time=min(known, default=None),
        last_time=max(known, default=None),
        definition=parts[0].definition,
        losses=losses,
        kinds=frozenset().union(*(part.kinds for part in parts)),
    )
