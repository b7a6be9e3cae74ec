"""What of a bag is damaged and left out, while all the rest of it is analysed."""

from __future__ import annotations

from rpud_sim.bag import BagFormatError, BagReader


class Damages:
    """Counts what is left out of an analysis because it is damaged.

    Args:
        bag: whose damaged topics and records are the first.
    """

    def __init__(self, bag: BagReader) -> None:
        self._others = bag.damages
        self._messages: dict[str, tuple[int, str]] = {}

    def add(self, topic: str, reason: str) -> None:
        """Count a message that is left out."""
        count, first = self._messages.get(topic, (0, reason))
        self._messages[topic] = count + 1, first

    def records(self, bag: BagReader, name: str) -> list[dict[str, str]]:
        """Return the metadata records of a name; none where they are damaged."""
        try:
            return bag.records(name)
        except BagFormatError as error:
            self.leave_out_record(name, error)
            return []

    def leave_out_record(self, name: str, error: BagFormatError) -> None:
        """Count a metadata record that is left out."""
        self._others[f"record {name}"] = str(error)

    @property
    def texts(self) -> dict[str, str]:
        """How much is left out and why, by topic or record."""
        found = dict(self._others)
        for topic, (count, reason) in self._messages.items():
            found[topic] = f"{count} of its messages: {reason}"
        return found
