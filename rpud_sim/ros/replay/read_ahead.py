"""Iterator whose messages a thread reads ahead, in bounded memory."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Generator, Iterable

from rpud_sim.bag import Message

_BATCH_MESSAGES = 256
_BATCH_BYTES = 1 << 20  # beyond which a batch ends
_BATCHES = 16


class ReadAhead:
    """Iterator over messages that a thread reads in advance.

    At most about 4,000 messages wait, or 16 MiB and one message for each of 16 batches. So many are
    read when it is made: later on the thread has little to do at a time, and the messages before it
    are not late. An error of reading is raised after the last message. While it is open no one else
    may read the same files.
    """

    def __init__(self, messages: Iterable[Message]) -> None:
        self._batches: deque[list[Message] | Exception] = deque()
        self._room = threading.Semaphore(_BATCHES)
        self._filled = threading.Semaphore(0)
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
        self._room.release()
        self._thread.join()

    def _iterate(self) -> Generator[Message, None, None]:
        while True:
            self._filled.acquire()
            batch = self._batches.popleft()
            if isinstance(batch, Exception):
                raise batch
            if not batch:
                return
            yield from batch
            self._room.release()

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
        if not self._room.acquire(blocking=False):
            self._full.set()
            self._room.acquire()
        if self._closed:
            return False
        self._batches.append(batch)
        self._filled.release()
        return True
