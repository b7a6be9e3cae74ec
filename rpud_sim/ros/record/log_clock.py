"""Clock of a recording: the machine's, or ``/clock`` where the drill is its source."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

_MOST_TICKS = 100_000  # of /clock that wait for messages: a quarter of an hour at 100 Hz

_STEP = 1_000_000  # by which a clock is set, and does not only drift [ns]


class ReceptionTime:
    """Times of the machine that continue where its clock is set back, by NTP or by hand.

    So messages have the order in which they came. The times agree with the clock again when it is
    set forward.
    """

    def __init__(
        self, wall: Callable[[], int] = time.time_ns, steady: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.shift = 0  # from the machine's clock [ns]
        self._wall, self._steady = wall, steady
        self._ahead = wall() - steady()

    def now(self) -> int:
        """Return the time of now [ns]; notice that the clock was set."""
        before, wall, after = self._steady(), self._wall(), self._steady()
        if after - before < _STEP // 2:  # no break between the two clocks
            back, self._ahead = self._ahead - (wall - after), wall - after
            if abs(back) >= _STEP:
                self.shift = max(0, self.shift + back)
        return wall + self.shift

    def of(self, received: int, sent: int, latest: int) -> tuple[int, int]:
        """Return when a message came and was sent, after the latest one of its topic [ns]."""
        # What has a time to come was received before the clock was set back.
        came = max(latest, min(received + self.shift, self.now()))
        return came, min(sent + self.shift, came) if self.shift else sent


class LogClock:
    """Log times of messages by the times of their reception [ns].

    Messages wait until it is decided whose clock counts, and that one has a time. Where ``/clock``
    goes back, as at a reset, log times continue from where they were: in a bag they never go back.
    """

    def __init__(self) -> None:
        self.simulated = False  # whether the time of ``/clock`` counts
        self._known = threading.Event()
        # When a tick was received, and the log time from then on.
        self._ticks: deque[tuple[int, int]] = deque(maxlen=_MOST_TICKS)
        self._latest, self._shift = 0, 0

    @property
    def decided(self) -> bool:
        return self.simulated or self._known.is_set()

    def use_machine(self) -> None:
        """Let the machine's clock count."""
        self.simulated = False
        self._known.set()

    def use_simulation(self) -> None:
        """Let ``/clock`` count, from its first tick on."""
        self.simulated = True
        if self._ticks:
            self._known.set()

    def add(self, received: int, time: int) -> None:
        """Take a tick of ``/clock`` that was received at a time of the machine [ns]."""
        if self._ticks and time + self._shift < self._latest:
            self._shift = self._latest - time
        self._latest = max(0, time + self._shift)
        self._ticks.append((received, self._latest))
        if self.simulated:
            self._known.set()

    def finish(self) -> bool:
        """Let nothing wait any more; return whether the clock that counts has had a time."""
        had = self._known.is_set() or not self.simulated
        if not self._known.is_set():
            self.use_machine()
        return had

    def wait(self) -> None:
        """Wait until messages have log times."""
        self._known.wait()

    def at(self, received: int) -> int:
        """Return the log time of a message [ns]; messages come in the order of their reception."""
        if not self.simulated:
            return received
        while len(self._ticks) > 1 and self._ticks[1][0] <= received:
            self._ticks.popleft()
        return self._ticks[0][1]
