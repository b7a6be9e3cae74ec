"""Watch over one drill: what its status, faults, journal and results of commands say."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import CommandResult, CommandResults, Faults, JournalEntry, Status

from rpud_sim.foundation.time import join_seconds
from rpud_sim.ros.client.drill_search import publisher_names
from rpud_sim.ros.client.errors import NoDrillError
from rpud_sim.ros.client.listening_node import ListeningNode

_STATUS = "rpud_msgs/msg/Status"
_STATUS_PERIOD = 2.5  # in which every living drill publishes a status, at any load [s]
_LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_JOURNAL = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class DrillWatch:
    """Latest status and faults of a drill, and the fate of a command."""

    def __init__(self, listening: ListeningNode) -> None:
        self.status: Status | None = None  # the latest, None before the first
        self.faults: Faults | None = None  # the latest, None before the first
        self.statuses = 0  # count of the statuses that came
        # called with the name of a topic (``status``, ``faults``, ``journal``,
        # ``command_results``) and each of its messages
        self.observer: Callable[[str, Any], object] = lambda topic, message: None
        self._listening = listening
        self._sequence: deque[int] = deque(maxlen=100)  # publication numbers of the statuses
        self._awaited = ""  # frame of the command whose result is awaited
        self._result: CommandResult | None = None  # of that command
        self._shown = 0  # number of the status that shows it
        listening.subscribe(Status, "status", self._on_status, _LATCHED)
        listening.subscribe(Faults, "faults", self._on_faults, _LATCHED)
        listening.subscribe(JournalEntry, "journal", self._on_entry, _JOURNAL)
        listening.subscribe(CommandResults, "command_results", self._on_results, _LATCHED)

    @property
    def number(self) -> int:
        """Number that the publisher has given to the latest status; 0 before the first."""
        return self._sequence[-1] if self._sequence else 0

    @property
    def publishers(self) -> list[str]:
        """Full names of the nodes that publish the status."""
        node = self._listening.node
        return publisher_names(node, node.resolve_topic_name("status"), _STATUS)

    def check_alone(self) -> None:
        """Check that one drill alone is there; one that was killed counts for nothing."""
        if len(self.publishers) < 2:
            return
        # The middleware remembers a killed drill for 20 s. Only the numbers of living ones go on.
        deadline = time.monotonic() + _STATUS_PERIOD
        while time.monotonic() < deadline and len(names := self.publishers) > 1:
            if any(after <= before for before, after in pairwise(self._sequence)):
                topic = self._listening.node.resolve_topic_name("status")
                known = ", ".join(filter(None, names))
                raise NoDrillError(
                    f"{len(names)} nodes publish {topic} ({known}): all of them would answer; "
                    "start each drill in a namespace of its own"
                )
            self._listening.spin(0.02)

    def result_of(
        self, command: Callable[[], object], frame: str, patience: float
    ) -> CommandResult:
        """Give a command whose header has this frame; return what became of it.

        The latest status shows it then.
        """
        self._awaited, self._result = frame, None
        command()
        what = "the drill did not accept the command"
        result = self._listening.until(lambda: self._result, patience, what)
        self._listening.until(
            lambda: not self._sequence or self.number >= self._shown, patience, what
        )
        return result

    def _on_status(self, status: Status, info: dict[str, Any]) -> None:
        self.status = status
        self.statuses += 1
        if info.get("publication_sequence_number") is not None:
            self._sequence.append(info["publication_sequence_number"])
        self.observer("status", status)

    def _on_faults(self, faults: Faults) -> None:
        self.faults = faults
        self.observer("faults", faults)

    def _on_entry(self, entry: JournalEntry) -> None:
        self.observer("journal", entry)

    def _on_results(self, results: CommandResults) -> None:
        for result in results.results:
            if result.header.frame_id == self._awaited != "":
                self._result, self._shown = result, results.status
        self.observer("command_results", results)


def stamp_of(message: Any) -> int:
    """Return the stamp of a message with a header [ns]."""
    stamp = message.header.stamp
    return join_seconds(stamp.sec, stamp.nanosec)
