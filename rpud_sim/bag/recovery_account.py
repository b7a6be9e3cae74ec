"""Account of a recovery: what the new bag holds, and what was lost."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rpud_sim.bag.metadata import Losses

_SHOWN = 1000  # damages that are stored one by one


@dataclass
class TopicRecovery:
    """Recovered and lost messages of one topic."""

    name: str  # name of the topic
    type: str  # type of its messages
    recovered: int = 0  # messages in the new bag
    unchecked: int = 0  # recovered messages without a checksum
    lost: int = 0  # messages that are known to have been in the file
    # messages that the recorder lost; None if they were not counted
    recording_losses: Losses | None = None


@dataclass
class Recovery:
    """Result of a recovery."""

    path: Path  # path of the new bag
    topics: dict[str, TopicRecovery] = field(default_factory=dict)  # topics by their names
    # whether every file has the end of a closed one. If not, the messages that its recorder
    # had not written yet are missing.
    closed: bool = True
    max_loss: float | None = None  # greatest duration of those messages [s]; None if it is unknown
    size_lost: int = 0  # unreadable bytes
    damage_count: int = 0  # unreadable places, and parts that the new bag cannot hold
    damages: list[str] = field(default_factory=list)  # reasons for the first of these

    def note(self, reason: str) -> None:
        """Count a lost or omitted part, and keep the reason if there are few."""
        self.damage_count += 1
        if len(self.damages) < _SHOWN:
            self.damages.append(reason)

    def topic(self, name: str, type_name: str = "") -> TopicRecovery:
        """Return the account of a topic, new if it was not known; its first type remains."""
        topic = self.topics.setdefault(name, TopicRecovery(name, type_name))
        topic.type = topic.type or type_name
        return topic

    @property
    def message_count(self) -> int:
        """Messages in the new bag."""
        return sum(topic.recovered for topic in self.topics.values())

    @property
    def complete(self) -> bool:
        """Whether nothing that the files ever held is missing."""
        lost = any(topic.lost for topic in self.topics.values())
        return self.closed and not (self.damage_count or lost)

    def to_mapping(self) -> dict[str, Any]:
        """Return the account as plain values."""
        topics = [
            {**vars(topic), "recording_losses": losses.total if losses else None}
            for _, topic in sorted(self.topics.items())
            for losses in (topic.recording_losses,)
        ]
        calculated = {"complete": self.complete, "message_count": self.message_count}
        return {**vars(self), "path": str(self.path), **calculated, "topics": topics}
