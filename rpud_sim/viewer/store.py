"""What a server shows: a store of data, and what each browser looks at."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol


class StoreError(RuntimeError):
    """Something that a store cannot show; the text is one line, and the page ends with it."""


@dataclass(frozen=True)
class View:
    """Range of time that a browser shows: the last seconds, or from ``start`` to ``end``."""

    follow: float | None = 20.0  # s; None for a fixed range
    start: float = 0.0  # s
    end: float = 0.0  # s
    width: int = 1000  # of a plot [px]


@dataclass
class ClientState:
    """What one browser looks at, and the store's own notes of what it has sent there."""

    drill: str = ""  # namespace; empty for the store's own choice
    view: View = View()
    choices: Mapping[str, str] = field(default_factory=dict)  # identifiers of choices by plot
    playhead: float | None = None  # s; None if it has none
    section: bool = True  # whether the newest block is wanted; a frame with a section clears it
    sent: dict[str, Any] = field(default_factory=dict)  # belongs to the store

    def is_due(self, name: str, key: Any, period: float = 0.0) -> bool:
        """Return whether a field has changed and is older than a period [s]; it is sent then."""
        before, at = self.sent.get(name, (None, -math.inf))
        if key == before or time.monotonic() - at < period:
            return False
        self.sent[name] = key, time.monotonic()
        return True


class Store(Protocol):
    """Data that browsers look at. All methods are called from one thread, which may be any."""

    mode: str  # ``live`` or ``recorded``

    def open(self, client: ClientState) -> None:
        """Note one more browser, or another drill of it; StoreError if there is nothing to show."""

    def frame(self, client: ClientState) -> dict[str, Any] | None:
        """Return fields of the next frame without ``number``; None if nothing is new."""

    def request(self, client: ClientState, name: str, content: Any) -> None:
        """Do what a browser asks: ``act`` and its arguments, or ``seek``; ParameterError if not."""

    def close(self, client: ClientState) -> None:
        """Note that a browser has gone, or is about to show another drill."""

    def tidy(self) -> None:
        """Free what no browser needs any more; called every few seconds."""
