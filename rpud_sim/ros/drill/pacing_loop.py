"""Pacing loop: the one thread that moves the session, or changes it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

from rpud_sim.ros.drill.session import Session
from rpud_sim.ros.threads import RequestError, Requests
from rpud_sim.simulation.configuration import Settings

_LONGEST_WAIT = 0.5  # so that a stop is noticed whatever happens to the event [s]
LAST_RESPONSE = 1.0  # for a response to arrive before the process ends [s]


def take_turn(session: Session) -> float:
    """Do what is due now; return for how long nothing more is due [s].

    Blocks are computed ahead of their deadlines and published at them. What has no deadline is
    published between deadlines.
    """
    timeline, pacer = session.timeline, session.timeline.pacer
    session.follow_clock()
    if timeline.standing:
        session.act()
        session.report_if_due()
        return session.publish_clock_at_standstill()
    session.publishers.look()
    if timeline.source.follows:
        session.act()  # what came while another's clock was stopped acts from there on
    until = session.next_end
    if timeline.playing and (idle := pacer.idle(until)) > 0.0:
        session.report_if_due()
        session.publish_deferred(until)
        return idle
    messages, impacts = session.advance(until)
    if pacer.ahead:
        session.publish_deferred(until)
    pacer.wait(until)
    session.publish(messages, impacts)
    session.act()
    if not pacer.ahead:
        session.publish_deferred()
    session.report_if_due()
    return 0.0


class PacingLoop:
    """Thread of a session, from ``start`` to the end of its run or ``clean_up``."""

    def __init__(self) -> None:
        self.session: Session | None = None  # from the node's configuration to its clean-up
        self.failure: BaseException | None = None  # error that ended the thread
        self._thread: threading.Thread | None = None
        self._waking = threading.Event()
        self.wake = self._waking.set  # to be called when there is something to do
        self._stop = threading.Event()
        self._finished = threading.Event()
        self._requests = Requests(self.wake)
        self._quit_at = math.inf

    @property
    def started(self) -> Session | None:
        """Session, to be read; None until it has begun."""
        return self.session if self._thread is not None else None

    @property
    def finished(self) -> bool:
        """Whether the process is to end: the drill has ended by itself, or ``quit`` is done."""
        return self._finished.is_set() or time.monotonic() >= self._quit_at

    def configure(self, session: Session) -> None:
        """Take a session, which nothing moves yet."""
        self.session = session
        self._stop.clear()
        session.announce()

    def start(self, settings: Settings) -> None:
        """Begin, active, with settings that may have changed: simulation time zero is now."""
        assert self.session is not None  # an inactive node is configured
        self.session.begin(settings)
        self._requests = Requests(self.wake)
        arguments = (self.session, self._requests)
        self._thread = threading.Thread(target=self._run, args=arguments, name="pacing")
        self._thread.start()

    def request(self, action: Callable[[Session], Any]) -> Any:
        """Have something done between two blocks; see ``Requests.do``."""
        if (session := self.started) is None:
            raise RequestError("the node has not been activated")
        return self._requests.do(lambda: action(session))

    def quit(self) -> None:
        """End the drilling at a client's request, and the process when that has its response."""
        self._end()
        self._quit_at = time.monotonic() + LAST_RESPONSE

    def stop(self) -> None:
        """End the drilling, publish the last status, and wait until running subscribers have it."""
        self._end()
        if self._thread is not None:
            self._thread.join()
        if self.session is not None:
            self.session.deliver()

    def clean_up(self) -> None:
        """Stop, and give up the session."""
        self.stop()
        session, self.session, self._thread = self.session, None, None
        if session is not None:
            session.close()

    def _end(self) -> None:
        self._stop.set()
        self.wake()

    def _run(self, session: Session, requests: Requests) -> None:
        # Any error must end the process too, or it would continue in silence.
        try:
            session.start_time(self._stop, requests.serve)
            while not (self._stop.is_set() or session.finished):
                requests.serve()
                if (idle := take_turn(session)) > 0.0:
                    self._waking.wait(min(idle, _LONGEST_WAIT))
                    self._waking.clear()
            session.finish()
        except Exception as error:
            self.failure = error
        finally:
            if not self._stop.is_set():
                self._finished.set()
            session.timeline.interrupt("the drill has stopped")
            requests.close()
