"""Bag that pages show: opened once, read on in the background, shared by all pages."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rpud_sim.watch.recorded.marks import Marks
from rpud_sim.watch.recorded.overview import Overview
from rpud_sim.watch.recorded.recording import Recording
from rpud_sim.watch.recorded.window import Answer, Request, Windows


class BagView:
    """Recording with its overview and its marks, and the thread that reads on.

    When it is made it has read a sample of the bag, so that a page can stand at once. Questions of
    pages go first: the thread waits meanwhile.
    """

    def __init__(self, path: str | Path) -> None:
        self.recording = Recording(path)
        try:
            self.overview = Overview(self.recording)
            self.overview.sample()
            self.marks = Marks(self.recording)
            self.marks.read_first()
            self.windows = Windows(self.recording, self.overview)
        except BaseException:
            self.recording.close()
            raise
        self._asking = 0
        self._condition = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._read_on, name="read the bag", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """End the thread and release the files."""
        with self._condition:
            self._ended = True
            self._condition.notify_all()
        if self._thread.is_alive():
            self._thread.join()
        self.recording.close()

    def __enter__(self) -> BagView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def asking(self) -> Iterator[None]:
        """Keep the thread from reading on meanwhile."""
        with self._condition:
            self._asking += 1
        try:
            yield
        finally:
            with self._condition:
                self._asking -= 1
                self._condition.notify_all()

    @property
    def banner(self) -> str:
        """What a reader must know of the state of the bag; empty for nothing."""
        parts = []
        recording = self.recording
        if recording.unclosed:
            parts.append(
                "This bag was not closed: it is still being recorded, or lost its end. "
                "The page shows what was there when it was opened."
            )
        if changed := recording.changed:
            parts.append(f"{changed} since it was opened; the page goes on with what it has.")
        if recording.damages:
            first = next(iter(recording.damages.values()))
            parts.append(f"{len(recording.damages)} damaged parts are skipped: {first:.300}")
        unreadable = {
            name: reader.unreadable
            for name, reader in recording.readers.items()
            if reader.unreadable
        }
        if unreadable:
            texts = (f"{count} of {name:.100}" for name, count in list(unreadable.items())[:5])
            parts.append(f"Messages that cannot be read: {', '.join(texts)}.")
        if not recording.signals:
            parts.append("The bag holds no numbers that can be drawn over time.")
        return " ".join(parts)

    def _read_on(self) -> None:
        while self._may_read() and self.overview.read_next():
            pass
        while self.marks.left and self._may_read():
            self.marks.read(self.marks.left[:1])
        if self.overview.progress.complete:
            self.marks.set_gaps(self.overview.gaps())

    def _may_read(self) -> bool:
        with self._condition:
            self._condition.wait_for(lambda: self._ended or not self._asking)
            return not self._ended


class Answerer:
    """Thread of one page that answers its newest request; older ones are dropped.

    ``deliver`` is called in the thread with each answer, and whether it is the last one.
    """

    def __init__(self, view: BagView, deliver: Callable[[Answer], object]) -> None:
        self._view = view
        self._deliver = deliver
        self._condition = threading.Condition()
        self._request: Request | Callable[[], object] | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="answer a page", daemon=True)
        self._thread.start()

    def ask(self, request: Request | Callable[[], object]) -> None:
        """Answer a request, or call a function, as soon as the present one is done."""
        with self._condition:
            self._request = request
            self._condition.notify()

    def close(self) -> None:
        """End the thread; it does not wait for it."""
        with self._condition:
            self._ended = True
            self._condition.notify()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._ended or self._request is not None)
                if self._ended:
                    return
                request, self._request = self._request, None
            with self._view.asking():
                if isinstance(request, Request):
                    self._deliver(self._view.windows.answer(request))
                elif request is not None:
                    request()
