"""Hostile inputs to every way into the drill, and hostile bags to every reader."""

from __future__ import annotations

from typing import NamedTuple


class Outcome(NamedTuple):
    """Outcome of one input."""

    number: int  # which draws it again, with the seed
    way: str
    refused: bool
    seconds: float
    harms: list[str]
    memory: float = 0.0  # of a process of its own [MB]
