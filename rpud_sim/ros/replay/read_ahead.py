"""Messages that are read before they are wanted, by a thread, in bounded memory."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Generator, Iterable

from rpud_sim.bag import Message

_BATCH_MESSAGES = 256
_BATCH_BYTES = 1 << 20  # beyond which a batch ends
_BATCHES = 16


class ReadAhead:
    """Iterates over messages that a thread reads in advance.

    At most about 4,000 messages wait, and of large ones no more than fit into 16 MiB and a message
    for each of its batches. What reading raises is raised where the messages end. While it is open
    nobody else may read from the same files.
    """

    def __init__(self, messages: Iterable[Message]) -> None:
        self._batches: deque[list[Message] | Exception] = deque()
        self._room = threading.Semaphore(_BATCHES)
        self._filled = threading.Semaphore(0)
        self._closed = False
        self._given = self._give()
        self._thread = threading.Thread(target=self._read, args=(messages,), daemon=True)
        self._thread.start()

    def __iter__(self) -> ReadAhead:
        """Give the iterator itself."""
        return self

    def __next__(self) -> Message:
        """Give the next message; wait until it is read."""
        return next(self._given)

    def close(self) -> None:
        """End reading, and wait until nothing is read any more."""
        self._closed = True
        self._given.close()
        self._room.release()
        self._thread.join()

    def _give(self) -> Generator[Message, None, None]:
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

    def _hand_over(self, batch: list[Message] | Exception) -> bool:
        self._room.acquire()
        if self._closed:
            return False
        self._batches.append(batch)
        self._filled.release()
        return True
