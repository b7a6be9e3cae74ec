"""Playback of a bag: messages when they are due, under control; times in ns."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Generator, Iterable
from contextlib import suppress
from math import inf
from typing import Protocol, TypeVar

from rpud_sim.bag import Message
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.options import RATE, ReplayOptions
from rpud_sim.ros.threads import DelayHistogram, RequestError, Requests, schedule_thread

_BATCH_MESSAGES = 256
_BATCH_BYTES = 1 << 20  # beyond which a batch ends
_BATCHES = 16
_BEHIND = SECOND // 20  # later than this, messages come as fast as they can
_LOOP_PAUSE = SECOND // 10  # between two passes, so that a bag of one message is not a flood
_BUNDLE_TIME = SECOND // 1000  # in which messages are published before requests are served again
_LONGEST_SLEEP = 3600.0  # s; the system call rejects more than some decades
_SHORTEST_SLEEP = 2e-4  # s; messages of less than this come together, and wake their listeners once

Result = TypeVar("Result")
Messages = Generator[Message, None, None]


def read_ahead(messages: Iterable[Message]) -> Messages:
    """Yield messages that a thread reads in advance, with the error of reading at the end.

    At most about 4,000 messages, or 16 MiB, wait. Until it is closed nobody else may read the
    files.
    """
    batches: queue.Queue[list[Message] | Exception | None] = queue.Queue(_BATCHES)
    full, closed = threading.Event(), threading.Event()

    def hand_over(item: list[Message] | Exception | None) -> None:
        if batches.full():
            full.set()
        batches.put(item)

    def read() -> None:
        batch: list[Message] = []
        size = 0
        end = None
        try:
            for message in messages:
                batch.append(message)
                size += len(message.data)
                if len(batch) == _BATCH_MESSAGES or size >= _BATCH_BYTES:
                    hand_over(batch)
                    batch, size = [], 0
                if closed.is_set():
                    return
        except Exception as error:
            end = error
        hand_over(batch)
        hand_over(end)
        full.set()

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    full.wait()
    try:
        while (batch := batches.get()) is not None:
            if isinstance(batch, Exception):
                raise batch
            yield from batch
    finally:
        closed.set()
        with suppress(queue.Empty):  # the thread may wait for space
            while True:
                batches.get_nowait()
        thread.join()


class Outputs(Protocol):
    """Publishers of a replay."""

    def publish(self, message: Message, *, hurried: bool) -> bool:
        """Publish a message of the bag, and return whether it can be published.

        ``hurried`` waits for subscribers that are behind.
        """

    def publish_clock(self, bag_time: int) -> None:
        """Publish a time [ns] on ``/clock``."""


class Playback:
    """Publishes messages at times that can be paused, stepped, sped up and moved.

    ``read`` opens the messages from a time of the bag [ns] on, up to the last to be played;
    ``span`` has the first and last time. ``latched`` reads the last messages of latched topics
    before a time, which a subscriber would have then. One thread plays, by ``run``; others reach
    it by ``do``.
    """

    def __init__(
        self,
        read: Callable[[int], Messages],
        span: tuple[int, int],
        options: ReplayOptions,
        outputs: Outputs,
        clock: Callable[[], int] = time.monotonic_ns,
        interrupted: Callable[[], bool] = lambda: False,
        latched: Callable[[int], Iterable[Message]] = lambda position: (),
    ) -> None:
        self._read, self._latched = read, latched
        self._first, self._last = span
        self._loop = options.loop
        # Period of the messages on ``/clock`` [ns of real time]; None for none.
        self._period = None if options.clock is None else SECOND / options.clock
        self._outputs = outputs
        self._clock = clock
        self._interrupted = interrupted
        self._messages: Messages | None = None
        self._next: Message | None = None  # to publish; None at the end
        self.rate = options.rate  # bag time over real time, outside of pauses
        self.paused = options.start_paused
        self._from = self._first  # position in the bag from the clock's time ``_since`` on
        self._since = clock()
        self._tick = inf  # time of the clock at which ``/clock`` is due
        self._stopped = False
        self._failure: Exception | None = None
        self._wake = threading.Event()
        self._requests = Requests(self._wake.set, "the replay has ended")
        self.published = 0
        self.lateness = DelayHistogram()

    def run(self, priority: int = 0) -> None:
        """Play to the end, by real-time priority unless 0; raise errors of reading and sending."""
        schedule_thread(priority)
        try:
            self.begin()
            while (delay := self.advance()) is not None:
                if delay > 0:
                    self._wake.wait(min(max(delay, _SHORTEST_SLEEP), _LONGEST_SLEEP))
                self._wake.clear()
                self._requests.serve()
        finally:
            self._requests.close()
            self.close()

    def do(self, action: Callable[[Playback], Result]) -> Result:
        """Have something done between two messages; return its result, raise what it raises."""
        return self._requests.do(lambda: action(self))

    @property
    def position(self) -> int:
        """Position in the bag [ns]; never beyond a message that is still to be published."""
        position, following = self._position_at(self._clock()), self._next
        return position if following is None else min(position, following.log_time)

    def begin(self) -> None:
        """Start at the first time, now, when its first message is read."""
        self._go(self._first)
        if self._period is not None:
            self._tick = self._since

    def advance(self) -> float | None:
        """Publish what is due, for 1 ms at most; return when to call again [s], None at the end."""
        if self._stopped or self._interrupted():
            return None
        if self._failure is not None:
            raise self._failure
        if self._next is None and not self.paused:
            if not self._loop:
                return None
            self._go(self._first, _LOOP_PAUSE)
        due = self._due()
        now = self._clock()
        if now < min(due, self._tick):
            return (min(due, self._tick) - now) / SECOND
        if self._tick <= due:
            # A tick comes before the messages of its time, however late both are.
            self._outputs.publish_clock(self._position_at(round(self._tick)))
            self._tick += self._period or inf
            return 0.0
        end = now + _BUNDLE_TIME
        while due <= now < end and due < self._tick and not self._stopped:
            self.lateness.add(now - due)
            # Faster than recorded, subscribers are not used to it.
            self._publish(hurried=self.rate > 1.0 or now - due > _BEHIND)
            due, now = self._due(), self._clock()
        return 0.0

    def stop(self) -> None:
        """End the playback; any thread may call this."""
        self._stopped = True
        self._wake.set()

    def close(self) -> None:
        if self._messages is not None:
            self._messages.close()

    # Requests: of the thread that plays.

    def pause(self, paused: bool = True) -> None:
        if paused != self.paused:
            self._stay()
            self.paused = paused

    def set_rate(self, rate: float) -> None:
        """Set bag time over real time, in the range of ``RATE``."""
        try:
            RATE.check("rate", rate)
        except ParameterError as error:
            raise RequestError(str(error)) from None
        self._stay()
        self.rate = rate

    def seek(self, position: int) -> None:
        """Go to a time of the bag [ns], from the first to the last that is played."""
        if not self._first <= position <= self._last:
            where, end = "after the last", self._last
            if position < self._first:
                where, end = "before the first", self._first
            raise RequestError(f"time = {position / SECOND:.3f} s is {where}, {end / SECOND:.3f} s")
        self._go(position)

    def play_next(self) -> None:
        """Publish the next message of a paused playback; its time is the position then."""
        if not self.paused:
            raise RequestError("the replay is not paused")
        if self._next is None:
            raise RequestError("the replay is at its end")
        self._from = self._next.log_time
        if self._period is not None:
            self._outputs.publish_clock(self._from)
        self._publish(hurried=True)

    def _position_at(self, now: int) -> int:
        if self.paused:
            return self._from
        return self._from + round(max(0, now - self._since) * self.rate)

    def _due(self) -> float:
        """Return the time of the clock at which the next message is due; infinite for never."""
        if self._next is None or self.paused:
            return inf
        return self._since + (self._next.log_time - self._from) / self.rate

    def _stay(self) -> None:
        """Let a change of rate or pause begin here, and not beyond a message that is due."""
        self._from, self._since = self.position, max(self._clock(), self._since)

    def _go(self, position: int, pause: int = 0) -> None:
        """Read from a position on, and be there after a pause; first give what is latched there."""
        self.close()
        try:
            for message in self._latched(position):
                self._outputs.publish(message, hurried=True)
        except Exception as error:  # as in ``_take``
            self._failure = error
        self._messages = self._read(position)
        self._take()
        self._from, self._since = position, self._clock() + pause

    def _publish(self, *, hurried: bool) -> None:
        assert self._next is not None
        self.published += self._outputs.publish(self._next, hurried=hurried)
        self._take()

    def _take(self) -> None:
        """Take the next message; none at the end and after an error of reading."""
        assert self._messages is not None
        self._next = None
        if self._failure is not None:
            return
        try:
            self._next = next(self._messages, None)
        except Exception as error:  # it ends the replay, not only the request that led here
            self._failure = error
