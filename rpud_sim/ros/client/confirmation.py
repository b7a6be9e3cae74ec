"""Confirmation of a command: whether the drill has accepted or refused it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from rpud_msgs.msg import JournalEntry, Status

from rpud_sim.foundation.time import join_seconds


class Confirmation:
    """Evidence about one command, from the status and the journal of the drill.

    The status counts commands but does not say whose they are. So a command counts as accepted when
    the counter has risen and its ``values`` are in force, in the status ``shown``; if another
    publisher's command overrides it at once, the journal shows it. ``before`` is the latest status
    when the command was sent.
    """

    def __init__(
        self, kind: str, values: Mapping[str, Any], shown: Mapping[str, Any], before: Status
    ) -> None:
        self.kind = kind
        self._values = values
        self._shown = shown
        self._accepted = before.commands_accepted
        self._rejected = before.commands_rejected
        self._stamp = stamp_of(before)
        self._counted = False
        self._in_force = False
        self.refused = 0

    @property
    def accepted(self) -> bool:
        return self._counted and self._in_force

    def see_status(self, status: Status) -> None:
        """Look at a status that came after the command was sent."""
        if status.commands_accepted < self._accepted or status.commands_rejected < self._rejected:
            self._accepted = self._rejected = 0  # a reset counts from zero again
        if status.commands_accepted > self._accepted:
            self._counted = True
            self._in_force |= all(
                getattr(status, name) == value for name, value in self._shown.items()
            )
        if status.commands_rejected > self._rejected:
            self.refused = status.commands_rejected

    def see_entry(self, entry: JournalEntry) -> None:
        """Look at an entry of the journal; old ones may come late, as the journal is latched."""
        if entry.kind == self.kind and stamp_of(entry) > self._stamp:
            with suppress(ValueError):  # a stranger may publish there too
                content = json.loads(entry.content)
                self._in_force |= isinstance(content, dict) and all(
                    content.get(name) == value for name, value in self._values.items()
                )


def stamp_of(message: Any) -> int:
    """Return the stamp of a message with a header [ns]."""
    stamp = message.header.stamp
    return join_seconds(stamp.sec, stamp.nanosec)
