"""Watch over one drill: what its status, faults, journal and diagnostics say."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import Faults, JournalEntry, Status

from rpud_sim.ros.client.confirmation import Confirmation
from rpud_sim.ros.client.drill_search import publisher_names
from rpud_sim.ros.client.errors import NoAnswerError, NoDrillError
from rpud_sim.ros.client.listening_node import ListeningNode

_STATUS = "rpud_msgs/msg/Status"
_STATUS_PERIOD = 2.5  # in which every living drill publishes a status, at any load [s]
_GRACE = 2.0  # in which a command may be accepted after another publisher's was refused [s]
_REASON = 3.0  # until the diagnostics show the reason of a refusal [s]; they come every second
_LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_DIAGNOSTICS = QoSProfile(depth=100)
_JOURNAL = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class DrillWatch:
    """Latest status and faults of a drill, and the fate of a command."""

    def __init__(self, listening: ListeningNode) -> None:
        self.status: Status | None = None  # the latest, None before the first
        self.faults: Faults | None = None  # the latest, None before the first
        self.statuses = 0  # count of the statuses that came
        # called with the name of a topic (``status``, ``faults``, ``journal``) and each
        # of its messages
        self.observer: Callable[[str, Any], object] = lambda topic, message: None
        self._listening = listening
        self._sequence: deque[int] = deque(maxlen=100)  # publication numbers of the statuses
        self._refusals: dict[str, tuple[int, str]] = {}  # by name: count and latest reason
        self._confirmation: Confirmation | None = None
        listening.subscribe(Status, "status", self._on_status, _LATCHED)
        listening.subscribe(Faults, "faults", self._on_faults, _LATCHED)
        listening.subscribe(JournalEntry, "journal", self._on_entry, _JOURNAL)
        listening.subscribe(DiagnosticArray, "/diagnostics", self._on_diagnostics, _DIAGNOSTICS)

    @property
    def number(self) -> int:
        """Number that the publisher has given to the latest status; 0 before the first."""
        return self._sequence[-1] if self._sequence else 0

    @property
    def publishers(self) -> list[str]:
        """Full names of the nodes that publish the status."""
        node = self._listening.node
        return publisher_names(node, node.resolve_topic_name("status"), _STATUS)

    @property
    def last_refusal(self) -> tuple[int, str]:
        """Count of the commands that the drill has refused, and why it refused the latest."""
        return max((self._refusals.get(name, (0, "")) for name in self.publishers), default=(0, ""))

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

    def confirm(self, confirmation: Confirmation, patience: float) -> str | None:
        """Wait for the fate of a command that was sent; return why it was refused, None if not."""
        refused_at = 0.0

        def decided() -> bool:
            nonlocal refused_at
            if confirmation.accepted:
                return True
            if not confirmation.refused:
                return False
            refused_at = refused_at or time.monotonic()
            # The counter does not say whose command was refused. The latest status may be older
            # than the publisher of this command.
            node = self._listening.node
            alone = (
                self.status is not None
                and self.status.commanders <= 1
                and node.count_publishers(f"command/{confirmation.kind}") <= 1
            )
            return alone or time.monotonic() >= refused_at + _GRACE

        self._confirmation = confirmation
        try:
            self._listening.until(decided, patience, "the drill did not accept the command")
        finally:
            self._confirmation = None
        return None if confirmation.accepted else self._reason(confirmation.refused)

    def _reason(self, count: int) -> str:
        def reasons() -> list[str]:
            known = [self._refusals.get(name, (0, "")) for name in self.publishers]
            return [reason for refused, reason in known if refused >= count and reason]

        try:
            return self._listening.until(reasons, _REASON, "no reason came")[0]
        except NoAnswerError:
            return "the drill refused the command; its log says why"

    def _on_status(self, status: Status, info: dict[str, Any]) -> None:
        self.status = status
        self.statuses += 1
        if info.get("publication_sequence_number") is not None:
            self._sequence.append(info["publication_sequence_number"])
        if self._confirmation is not None:
            self._confirmation.see_status(status)
        self.observer("status", status)

    def _on_faults(self, faults: Faults) -> None:
        self.faults = faults
        self.observer("faults", faults)

    def _on_entry(self, entry: JournalEntry) -> None:
        self.observer("journal", entry)
        if self._confirmation is not None:
            self._confirmation.see_entry(entry)

    def _on_diagnostics(self, diagnostics: DiagnosticArray) -> None:
        for status in diagnostics.status:
            name, _, what = status.name.partition(": ")
            if what == "commands" and status.hardware_id == "rpud_sim":
                values = {each.key: each.value for each in status.values}
                refused = values.get("commands_rejected", "")
                if refused.isdecimal():
                    self._refusals[name] = int(refused), values.get("last_refusal", "")
