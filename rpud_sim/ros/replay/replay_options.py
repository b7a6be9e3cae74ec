"""Options of a replay. No ROS, so that help is quick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rpud_sim.foundation.quantities import Quantity

# Allowed rates of a replay; publishing is slower than the greatest.
RATE = Quantity("", "speed of a replay, in times real time", 0.0, 1e6, exclusive=True)
# Allowed rates of ``/clock``; its messages come before all others.
CLOCK_RATE = Quantity("Hz", "rate of /clock", 0.0, 1e4, exclusive=True)
DEFAULT_CLOCK_RATE = 40.0  # rate of ``/clock`` where ``--clock`` names none [Hz]
# Time that a replay waits for subscribers by default [s]; Fast DDS announces itself every 3 s.
DISCOVERY_TIME = 3.5


@dataclass(frozen=True)
class ReplayOptions:
    """What to replay, how fast, and under which names."""

    bag: str  # Folder or file of the bag
    rate: float = 1.0  # Speed in times real time
    start: float = 0.0  # Seconds of the bag to skip
    duration: float | None = None  # Seconds of the bag to replay; to its end if None
    loop: bool = False  # Whether to begin again at the end
    clock: float | None = None  # Rate of ``/clock`` [Hz]; no ``/clock`` if None
    topics: Sequence[str] | None = None  # Absolute names of the topics to replay; all if None
    exclude: Sequence[str] = ()  # Absolute names of topics not to replay
    # Rules ``OLD:=NEW`` with absolute names, for publishing under other names
    remap: Sequence[str] = ()
    start_paused: bool = False  # Whether to wait at the beginning to be resumed
    # Whether to wait without limit for a subscriber of every topic
    wait_for_subscribers: bool = False
    with_parent: bool = False  # Whether to stop also where the parent process has ended
