"""Drill node as its services see it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from rpud_sim.ros.drill.drilling import Drilling
from rpud_sim.simulation.configuration import Settings


class DrillHost(Protocol):
    """Interface of the node for its services."""

    @property
    def settings(self) -> Settings:
        """Settings of the node."""

    @property
    def configured(self) -> bool:
        """Whether the node is configured: there is a drill, which may not drill yet."""

    @property
    def drilling(self) -> Drilling | None:
        """Drilling, to be read; None until the node has been activated."""

    def request(self, action: Callable[[Drilling], Any]) -> Any:
        """Have something done between two blocks; return what it returns, raise what it raises."""

    def refuse_request(self, reason: str) -> None:
        """Count a request that is refused, and log why."""

    def quit(self) -> None:
        """End the node."""
