"""Changes of a feed that are worth a segment, among many commands."""

from __future__ import annotations

import enum
from dataclasses import dataclass

_LASTS = 1.0  # s
_RATIO = 2.0  # of two rates
_WAY = 1e-3  # between two targets [m]


@dataclass(frozen=True)
class FeedCommand:
    """Command of the feed."""

    mode: str  # ``rate`` or ``position``
    value: float  # rate toward the rock [m/s], or position [m]

    def is_like(self, other: FeedCommand) -> bool:
        """Return whether it is no clear change from another one."""
        if self.mode != other.mode:
            return False
        if self.mode == "position":
            return abs(self.value - other.value) <= _WAY
        if self.value == 0.0 or other.value == 0.0:
            return self.value == other.value
        return 1.0 / _RATIO <= self.value / other.value <= _RATIO

    @property
    def text(self) -> str:
        if self.mode == "position":
            return f"feed to {1e3 * self.value:.4g} mm"
        return f"feed at {1e3 * self.value:.4g} mm/s" if self.value else "feed holds"


class Step(enum.Enum):
    """What a command does to the segments."""

    NOTHING = enum.auto()
    BEGINS = enum.auto()  # a segment, unless the feed comes back
    COMES_BACK = enum.auto()  # so that the last one that began is none


class FeedChanges:
    """Commands of a feed that begin a segment.

    A controller commands a feed 100 times a second, and its rate follows a force that oscillates.
    So a command begins a segment if it is a clear change from the feed with which the present
    segment began, and if the feed does not come back to that within a second. A clear change is
    another mode; another sign of the rate, or to or from zero; a rate of more than twice or less
    than half; a target that is more than 1 mm away. So there is at most one segment a second, and
    a motion of less than a second has none of its own.
    """

    def __init__(self) -> None:
        self._begun: FeedCommand | None = None  # None if it is not known
        self._next: FeedCommand | None = None  # that may have begun another segment
        self._since = 0.0

    def begin(self, known: bool) -> None:
        """Begin a run, in which the feed holds until the first command if that is known."""
        self._begun = FeedCommand("rate", 0.0) if known else None
        self._next = None

    def take(self, time: float, feed: FeedCommand) -> Step:
        """Return what a command does, at a time since the bag began [s]."""
        if self._next is not None and not 0.0 <= time - self._since < _LASTS:
            self._begun, self._next = self._next, None
        if self._begun is not None and feed.is_like(self._begun):
            came_back, self._next = self._next is not None, None
            return Step.COMES_BACK if came_back else Step.NOTHING
        if self._next is not None:
            return Step.NOTHING
        self._next, self._since = feed, time
        return Step.BEGINS
