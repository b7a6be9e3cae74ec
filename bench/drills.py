"""What a node costs by its telemetry rate, and how many drills drill in real time at once."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import rclpy
from rclpy.signals import SignalHandlerOptions

from bench.row import Row, row
from bench.talk import Talk

RATES = (1, 10, 100, 1000)  # of telemetry, over three decades [Hz]
SECONDS = 10.0
MOST = 64  # drills
_PERIOD = 0.01  # of blocks at the default rate [s]


def growth() -> Iterator[tuple[str, float, float]]:
    """Yield the telemetry rate [Hz] and the time of processors [s] of ten seconds of drilling."""
    with _ros():
        for rate in RATES:
            block = max(0.05, 1.0 / rate)
            parameters = {"telemetry_rate": rate, "block_duration": block}
            with Talk("drill_node", parameters) as talk:
                talk.settle()
                share = talk.measure(SECONDS).share
                yield "node: 10 s of drilling, by telemetry rate [Hz]", rate, share * SECONDS


def drills() -> Iterator[Row]:
    """Start more and more drills, all in one domain and each with a listener, until one is late.

    A drill keeps up if 99 % of its blocks are at most one period late. They double until one does
    not, then the number in between is sought.
    """
    with _ros():
        kept, failed, lateness = 0, MOST + 1, {0: 0.0}
        while failed - kept > 1:
            number = (
                min(max(1, 2 * kept), (kept + failed) // 2)
                if failed > MOST
                else (kept + failed) // 2
            )
            lateness[number] = _latest(number)
            if lateness[number] <= _PERIOD:
                kept = number
            else:
                failed = number
        yield row("drills that drill in real time at once", [kept])
        yield row("drills at once: greatest p99 lateness", [1e3 * lateness[kept]], "ms")


def _latest(number: int) -> float:
    """Return the greatest 99 % lateness of several drills at once [s]."""
    with contextlib.ExitStack() as stack:
        talks = [stack.enter_context(Talk("drill_node", {})) for _ in range(number)]
        for talk in talks:
            talk.settle()
        for _ in range(round(SECONDS)):
            for talk in talks:
                talk.listen(1.0 / number)
        return max(float(talk.diagnostics()["lateness_p99 [s]"]) for talk in talks)


@contextlib.contextmanager
def _ros() -> Iterator[None]:
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()
