"""The account of a recovery: what was found of each topic, and what is lost."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rpud_sim.bag.losses import Losses

_SHOWN = 1000  # damages that are kept one by one


@dataclass
class TopicRecovery:
    """What was found of one topic.

    `unchecked` of its `recovered` messages are not covered by a checksum. `lost` are those that
    are known to have been in the file; `gaps` are missing by the numbers in the messages
    themselves, None where they have none. `recording_losses` is what the recorder had lost.
    """

    name: str
    type: str
    recovered: int = 0
    unchecked: int = 0
    lost: int = 0
    gaps: int | None = None
    recording_losses: Losses | None = None


@dataclass
class Recovery:
    """What was recovered into the bag at `path`, and what was not.

    `closed` tells whether every file ends as one that was closed; where not, messages that its
    recorder had not written yet are missing, of at most `max_loss` seconds where that is known.
    `size_lost` are bytes that hold nothing readable; `damage_count` counts these places, and what
    no bag can have; `damages` names the first of both.
    """

    path: Path
    topics: dict[str, TopicRecovery] = field(default_factory=dict)
    closed: bool = True
    max_loss: float | None = None
    size_lost: int = 0
    damage_count: int = 0
    damages: list[str] = field(default_factory=list)

    def note(self, reason: str) -> None:
        """Count something that is lost or left out, and keep why, as far as these are few."""
        self.damage_count += 1
        if len(self.damages) < _SHOWN:
            self.damages.append(reason)

    @property
    def message_count(self) -> int:
        """Messages in the new bag."""
        return sum(topic.recovered for topic in self.topics.values())

    @property
    def complete(self) -> bool:
        """Whether nothing that the file ever held is missing."""
        lost = any(topic.lost for topic in self.topics.values())
        return self.closed and not (self.damage_count or lost)

    def to_mapping(self) -> dict[str, Any]:
        """Give it as plain values."""
        return {
            "path": str(self.path),
            "complete": self.complete,
            "closed": self.closed,
            "max_loss": self.max_loss,
            "message_count": self.message_count,
            "size_lost": self.size_lost,
            "damage_count": self.damage_count,
            "damages": self.damages,
            "topics": [
                {
                    "name": topic.name,
                    "type": topic.type,
                    "recovered": topic.recovered,
                    "unchecked": topic.unchecked,
                    "lost": topic.lost,
                    "gaps": topic.gaps,
                    "recording_losses": (
                        topic.recording_losses.total if topic.recording_losses else None
                    ),
                }
                for _, topic in sorted(self.topics.items())
            ],
        }
