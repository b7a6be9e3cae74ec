"""Configured drill: its publishers, its reporter, its drilling, and the thread that moves it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from rclpy.node import Node

from rpud_sim.ros.drill.drilling import Drilling
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.namesakes import DuplicateNodes
from rpud_sim.ros.drill.pacing_thread import PacingThread
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.status_reporter import StatusReporter
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.resumption import Start
from rpud_sim.simulation.topics import offered_topics

_ACKNOWLEDGEMENT = 1.0  # that the last messages may take to reach their subscribers [s]


class ConfiguredDrill:
    """What a drill node has from its configuration to its clean-up; nothing moves at first.

    Its arguments are those of ``Drilling``; ``sent`` counts the messages.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        inbox: Inbox,
        namesakes: DuplicateNodes,
        restored: Callable[[Settings], None],
        end: int,
        sent: Counter[str] | None,
        start: Start | None = None,
    ) -> None:
        offered = offered_topics(settings.values())
        self.publishers = DrillPublishers(node, settings.publish_clock, sent, offered)
        self.reporter = StatusReporter(
            node, settings.telemetry_rate, self.publishers, inbox, namesakes
        )
        try:
            self.drilling = Drilling(
                node, settings, self.publishers, self.reporter, inbox, restored, end, start
            )
        except Exception:
            self.publishers.destroy()  # or the next configuration would have each topic twice
            raise
        self.pacing = PacingThread(self.drilling)

    @property
    def time(self) -> int:
        """Stamp of the present simulation time [ns]."""
        return self.drilling.run.origin + self.drilling.run.time

    def activate(self, settings: Settings) -> None:
        """Let commands act; simulation time begins, with these settings, if it has not."""
        if self.pacing.started:
            self._activate_control(True)
        else:
            self.pacing.start(settings)

    def deactivate(self) -> None:
        """Make drive and weight on bit zero; the drill goes on without them."""
        self._activate_control(False)

    def report_before_start(self) -> None:
        """Publish the status, unless the drilling does it."""
        if not self.pacing.started:
            self.drilling.announce()

    def stop(self) -> None:
        """End the drilling, publish the last status, and wait until subscribers have it."""
        self.pacing.stop()
        self.publishers.wait_for_subscribers(_ACKNOWLEDGEMENT)

    def destroy(self) -> None:
        """Stop, and destroy the publishers."""
        self.stop()
        self.drilling.close()
        self.publishers.destroy()

    def _activate_control(self, active: bool) -> None:
        self.pacing.request(lambda drilling: drilling.act(lambda run: run.control.activate(active)))
