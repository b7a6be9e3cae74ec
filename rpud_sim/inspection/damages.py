"""Damaged parts of a bag that an analysis skips."""

from __future__ import annotations

from rpud_sim.bag import BagFormatError, BagReader


class Damages:
    """Damaged parts that an analysis of a bag skips; the account begins with the bag's own."""

    def __init__(self, bag: BagReader) -> None:
        self._parts = bag.damages
        self._messages: dict[str, tuple[int, str]] = {}

    def add(self, topic: str, reason: str) -> None:
        count, first = self._messages.get(topic, (0, reason))
        self._messages[topic] = count + 1, first

    def records(self, bag: BagReader, name: str) -> list[dict[str, str]]:
        """Return the metadata records of a name; none if they are damaged."""
        try:
            return bag.records(name)
        except BagFormatError as error:
            self.add_record(name, error)
            return []

    def add_record(self, name: str, error: BagFormatError) -> None:
        self._parts[f"record {name}"] = str(error)

    @property
    def texts(self) -> dict[str, str]:
        """Amount and reason of what is skipped, by topic or record."""
        messages = {
            topic: f"{count} of its messages: {reason}"
            for topic, (count, reason) in self._messages.items()
        }
        return {**self._parts, **messages}
