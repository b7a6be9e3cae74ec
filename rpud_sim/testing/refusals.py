"""Commands that the drill has rejected in a test: how many, and why the last one."""

from __future__ import annotations

import contextlib
from typing import Any

from rpud_sim.foundation.quantities import counted
from rpud_sim.ros.client import ClientError, DrillClient
from rpud_sim.testing.errors import DrillError

_PATIENCE = 1.0  # that a reason may take to arrive after the status that counts it [s]


class Refusals:
    """Reasons of rejected commands since the drill began the test, or was reset."""

    def __init__(self, client: DrillClient) -> None:
        self._client = client
        self.begin()
        client.observe(self._take, "command_results")

    def begin(self) -> None:
        """Forget everything: the drill has begun again."""
        self._begun = self._client.status_number
        self._reasons: list[str] = []

    def line(self, count: int) -> str:
        """Return how many commands are rejected, as the status counts, and why the last one.

        It is empty for none.
        """
        if not count:
            return ""
        with contextlib.suppress(ClientError, DrillError):
            self._client.until(lambda: len(self._reasons) >= count, _PATIENCE)
        reason = self._reasons[-1] if self._reasons else "its reason has not arrived"
        return f"{counted(count, 'command')} rejected, the last: {reason}"

    def _take(self, topic: str, message: Any, published: int) -> None:
        # Messages with an earlier number are of the run before.
        if message.status > self._begun:
            new = message.results[message.repeated :]
            self._reasons += [result.reason for result in new if not result.accepted]
