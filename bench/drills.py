"""How many drills drill in real time at once."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from bench.table import Row, row
from bench.talk import Talk, end, ros

SECONDS = 10.0
MOST = 64  # drills
_PERIOD = 0.01  # of blocks at the default rate [s]
_KEPT_UP = 99.0  # [%]
_SETTLING = 2.0  # after the last one is heard [s]
_REPORTS = 3.0  # by which two diagnostics may be apart more or less than the time between [s]
_TURNS = 4  # of listening to each drill in a second


def drills() -> Iterator[Row]:
    """Start more and more drills, all in one domain and each with a listener, until one is late.

    A drill keeps up if 99 % of its blocks are at most one period late. They double until one does
    not, then the number in between is sought.
    """
    with ros():
        kept, failed, in_time = 0, MOST + 1, dict[int, float]()
        while failed - kept > 1:
            number = max(1, 2 * kept) if failed > MOST else (kept + failed) // 2
            number = min(number, MOST)
            in_time[number] = _in_time(number)
            print(
                f"  {number} drills: {in_time[number]:.2f} % in time", file=sys.stderr, flush=True
            )
            if in_time[number] >= _KEPT_UP:
                kept = number
            else:
                failed = number
        yield row("drills that drill in real time at once", [kept])
        what = "drills at once: blocks within their period, of the worst drill"
        yield row(what, [in_time[max(kept, 1)]], "%")


def _in_time(number: int) -> float:
    """Return the blocks within their period of the worst of several drills at once [%]."""
    talks: list[Talk] = []
    try:
        for _ in range(number):
            talks.append(Talk({}))
        for talk in talks:
            talk.settle(0.0)
        talks[0].listen(_SETTLING)
        before = [_counts(talk) for talk in talks]
        for _ in range(round(SECONDS * _TURNS)):
            for talk in talks:
                talk.listen(1.0 / _TURNS / number)
        after = [_counts(talk) for talk in talks]
    except RuntimeError:  # one of them was not heard
        return 0.0
    finally:  # one after the other they would take minutes to end
        end(talks)
    # Those that are not there yet are late too.
    expected = (SECONDS - _REPORTS) / _PERIOD
    pairs = zip(before, after, strict=True)
    done = [(late - first_late, count - first) for (first_late, first), (late, count) in pairs]
    return min(
        100.0 * (1.0 - late / max(count, 1)) if count > expected else 0.0 for late, count in done
    )


def _counts(talk: Talk) -> tuple[int, int]:
    """Return the late blocks of a drill, and all of them, as of its latest diagnostics."""
    talk.hearing.take()
    values = talk.diagnostics()
    return int(values["deadlines_missed"]), int(values["blocks"])
