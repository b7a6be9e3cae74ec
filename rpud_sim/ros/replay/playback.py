"""Playback of a bag: messages when they are due, under control. No ROS; times in ns."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Generator, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Any

from rpud_sim.bag import Message
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.delay_histogram import DelayHistogram
from rpud_sim.ros.replay.replay_options import RATE

if TYPE_CHECKING:
    from rpud_sim.ros.replay.replayer_node import Replayer

_BATCH_MESSAGES = 256
_BATCH_BYTES = 1 << 20  # beyond which a batch ends
_BATCHES = 16
_BEHIND = SECOND // 20  # later than this, messages come as fast as they can
_LOOP_PAUSE = SECOND // 10  # between two passes, so that a bag of one message is no flood
_BUNDLE_TIME = SECOND // 1000  # in which messages are published before requests are served again


@dataclass(frozen=True)
class Timeline:
    """Position in a bag as a function of a monotonic clock; all times are integer nanoseconds.

    Every change but a seek keeps the position.
    """

    position: int  # in the bag until ``since``
    since: int  # time of the clock from which on it moves, unless it is paused
    rate: float = 1.0  # bag time over clock time
    paused: bool = False  # whether it stands still

    def position_at(self, now: int) -> int:
        if self.paused:
            return self.position
        return self.position + round(max(0, now - self.since) * self.rate)

    def due(self, position: int) -> float:
        """Return the time of the clock at which a position is reached; infinite if paused."""
        if self.paused:
            return float("inf")
        return self.since + (position - self.position) / self.rate

    def seek(self, now: int, position: int) -> Timeline:
        return replace(self, position=position, since=now)

    def changed(self, now: int, **changes: Any) -> Timeline:
        """Return one with another rate or pause from now on."""
        return replace(self, position=self.position_at(now), since=max(now, self.since), **changes)


class ReadAhead:
    """Iterator over messages that a thread reads in advance.

    At most about 4,000 messages wait, or 16 MiB and one message for each of 16 batches. So many are
    read when it is made: later on the thread has little to do at a time, and the messages before it
    are not late. An error of reading is raised after the last message. While it is open no one else
    may read the same files.
    """

    def __init__(self, messages: Iterable[Message]) -> None:
        self._batches: queue.Queue[list[Message] | Exception] = queue.Queue(_BATCHES)
        self._full = threading.Event()
        self._closed = False
        self._iterator = self._iterate()
        self._thread = threading.Thread(target=self._read, args=(messages,), daemon=True)
        self._thread.start()
        self._full.wait()

    def __iter__(self) -> ReadAhead:
        return self

    def __next__(self) -> Message:
        """Return the next message; wait until it is read."""
        return next(self._iterator)

    def close(self) -> None:
        """End reading, and wait until the thread has ended."""
        self._closed = True
        self._iterator.close()
        with suppress(queue.Empty):  # the thread may wait for room
            while True:
                self._batches.get_nowait()
        self._thread.join()

    def _iterate(self) -> Generator[Message, None, None]:
        while batch := self._batches.get():
            if isinstance(batch, Exception):
                raise batch
            yield from batch

    def _read(self, messages: Iterable[Message]) -> None:
        batch: list[Message] = []
        size = 0
        end: list[Message] | Exception = []
        try:
            for message in messages:
                batch.append(message)
                size += len(message.data)
                if len(batch) == _BATCH_MESSAGES or size >= _BATCH_BYTES:
                    if not self._hand_over(batch):
                        return
                    batch, size = [], 0
        except Exception as error:
            end = error
        if not batch or self._hand_over(batch):
            self._hand_over(end)
        self._full.set()

    def _hand_over(self, batch: list[Message] | Exception) -> bool:
        if self._batches.full():
            self._full.set()
        if self._closed:
            return False
        self._batches.put(batch)
        return True


class RefusedError(Exception):
    """Request that the state of the replay does not permit; it changes nothing."""


@dataclass(frozen=True)
class Plan:
    """Plan of a playback."""

    first: int  # time of the bag at which it begins [ns]
    last: int  # time of the bag at which it ends [ns]
    rate: float = 1.0  # bag time over real time
    paused: bool = False  # whether it begins with a pause
    loop: bool = False  # whether it repeats
    # period of the messages on ``/clock`` [ns of real time]; None for none
    tick: float | None = None


class Playback:
    """Publishes messages on a timeline that can be paused, stepped, sped up and moved.

    ``read`` opens the messages from a time of the bag [ns] on. ``clock`` is monotonic [ns].
    """

    def __init__(
        self,
        read: Callable[[int], ReadAhead],
        plan: Plan,
        outputs: Replayer,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._read = read
        self._plan = plan
        self._outputs = outputs
        self._clock = clock
        self._messages: ReadAhead | None = None
        self._next: Message | None = None
        self._timeline = Timeline(plan.first, clock(), plan.rate, plan.paused)
        self._tick = inf
        self._stopped = False
        self._failure: Exception | None = None
        self.published = 0
        self.lateness = DelayHistogram()

    @property
    def paused(self) -> bool:
        return self._timeline.paused

    @property
    def rate(self) -> float:
        """Bag time over real time, outside of pauses."""
        return self._timeline.rate

    @property
    def position(self) -> int:
        """Position in the bag [ns]; never beyond a message that is still to be published."""
        position = self._timeline.position_at(self._clock())
        following = self._next  # another thread may ask
        return position if following is None else min(position, following.log_time)

    def begin(self) -> None:
        """Start at the plan's first time, now, when its first message is read."""
        self._open(self._plan.first)
        now = self._clock()
        self._timeline = self._timeline.seek(now, self._plan.first)
        if self._plan.tick is not None:
            self._tick = now

    def advance(self) -> float | None:
        """Publish what is due, for a millisecond at most; return the time until the next call [s].

        Zero is at once, infinity is after the next request, None is the end. Errors of reading and
        publishing are raised.
        """
        if self._stopped:
            return None
        if self._failure is not None:
            raise self._failure
        if self._next is None and not self.paused:
            if not self._plan.loop:
                return None
            self._open(self._plan.first)
            self._timeline = self._timeline.seek(self._clock() + _LOOP_PAUSE, self._plan.first)
        due = inf if self._next is None else self._timeline.due(self._next.log_time)
        earliest = min(due, self._tick)
        now = self._clock()
        if now < earliest:
            return (earliest - now) / SECOND
        if self._tick <= due:
            # A tick comes before the messages of its time, however late both are.
            self._outputs.publish_clock(self._timeline.position_at(round(self._tick)))
            self._tick += self._plan.tick or inf
        else:
            self._publish_due(now)
        return 0.0

    def _publish_due(self, now: int) -> None:
        """Publish messages from ``now`` [ns] on, until none is due, or a tick, or the time is over.

        It works with local variables: everything in this loop is paid for each message.
        """
        timeline, message = self._timeline, self._next
        since, position, rate = timeline.since, timeline.position, timeline.rate
        publish, take, clock = self._outputs.publish, self._take, self._clock
        note, tick, end = self.lateness.add, self._tick, now + _BUNDLE_TIME
        fast = rate > 1.0  # than subscribers of the recorded publishers had to be
        count = 0
        try:
            while message is not None and now < end and not self._stopped:
                due = since + (message.log_time - position) / rate  # that of the timeline
                if now < due or tick <= due:
                    break
                note(now - due)
                publish(message, hurried=fast or now - due > _BEHIND)
                count += 1
                message = take()
                now = clock()
        finally:
            self.published += count
            self._next = message

    def stop(self) -> None:
        """End the playback; any thread may call this."""
        self._stopped = True

    def close(self) -> None:
        if self._messages is not None:
            self._messages.close()

    def pause(self) -> None:
        self._change(paused=True)

    def resume(self) -> None:
        if self.paused:
            self._change(paused=False)

    def toggle_paused(self) -> None:
        self.resume() if self.paused else self.pause()

    def set_rate(self, rate: float) -> None:
        """Set bag time over real time, in the range of ``RATE``."""
        try:
            RATE.check("rate", rate)
        except ParameterError as error:
            raise RefusedError(str(error)) from None
        self._change(rate=rate)

    def seek(self, position: int) -> None:
        """Go to a time of the bag [ns], or the first played if later; after the last is refused."""
        first, last = self._plan.first, self._plan.last
        if position > last:
            raise RefusedError(
                f"time = {position / SECOND:.3f} s is after the last, {last / SECOND:.3f} s"
            )
        position = max(first, position)
        self._open(position)
        self._timeline = self._timeline.seek(self._clock(), position)

    def play_next(self) -> None:
        """Publish the next message of a paused playback; its time is the position then."""
        if not self.paused:
            raise RefusedError("the replay is not paused")
        if self._next is None:
            raise RefusedError("the replay is at its end")
        time_of_next = self._next.log_time
        self._timeline = self._timeline.seek(self._clock(), time_of_next)
        if self._plan.tick is not None:
            self._outputs.publish_clock(time_of_next)
        self._outputs.publish(self._next, hurried=True)
        self.published += 1
        self._next = None
        self._next = self._take()

    def burst(self, count: int) -> int:
        """Publish the next messages of a paused playback, all for a count of 0; return how many."""
        if not self.paused:
            raise RefusedError("the replay is not paused")
        before = self.published
        while self._next is not None and not self._stopped:
            self.play_next()
            if self.published - before == count:
                break
        return self.published - before

    def _open(self, position: int) -> None:
        self.close()
        self._messages = self._read(position)
        self._next = None
        self._next = self._take()

    def _take(self) -> Message | None:
        """Return the next message to publish; None at the end and after an error of reading."""
        assert self._messages is not None
        try:
            message = next(self._messages, None)
        except Exception as error:  # it ends the replay, not only the request that led here
            self._failure = error
            return None
        return None if message is None or message.log_time > self._plan.last else message

    def _change(self, **changes: Any) -> None:
        """Change rate or pause from here on, and not from beyond a message that is due."""
        now = self._clock()
        if (position := self.position) < self._timeline.position_at(now):
            self._timeline = self._timeline.seek(now, position)
        self._timeline = self._timeline.changed(now, **changes)
