"""Functions that write formulas in Python as one reads them."""

from __future__ import annotations

import re
from typing import Any

from rpud_sim.foundation.quantities import shown
from rpud_sim.verdicts.units import ExpectationError, parse_duration
from rpud_sim.verdicts.vocabulary import (
    WHOLE,
    After,
    Always,
    Count,
    Event,
    Eventually,
    Formula,
    Quantile,
    Signal,
    Until,
    Window,
    to_number,
)

_SIGNAL = re.compile(r"([A-Za-z/][\w/]*)\.(\S.*)")


def signal(name: str, hold: str | float | None = None) -> Signal:
    """Return a signal by topic and field, as in ``reacting_force.force``.

    A value holds at most for ``hold``, as ``0.1 s``; None for that of the topic.
    """
    match = _SIGNAL.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        raise ExpectationError(f"{shown(name)} is not a topic and a field, as reacting_force.force")
    topic = "/diagnostics" if match[1] == "diagnostics" else match[1]
    return Signal(topic, match[2], None if hold is None else parse_duration(hold, "hold"))


def window(within: Any = None, between: Any = None) -> Window:
    """Return a window from its end, or from start and end; of neither, the rest of the recording.

    Both are as ``0.5 s``; an end of None is that of the recording.
    """
    if within is not None and between is not None:
        raise ExpectationError("within and between exclude each other")
    if between is None:
        return WHOLE if within is None else Window(0, parse_duration(within, "within"))
    if not isinstance(between, (list, tuple)) or len(between) != 2:
        raise ExpectationError(f"between = {shown(between)} is not [start, end], as [1 s, 2 s]")
    first, last = between
    end = None if last is None else parse_duration(last, "between")
    return Window(parse_duration(first, "between"), end)


def always(formula: Formula, within: Any = None, between: Any = None) -> Always:
    """Return the formula that ``formula`` holds at every instant of a window."""
    return Always(formula, window(within, between))


def eventually(formula: Formula, within: Any = None, between: Any = None) -> Eventually:
    """Return the formula that ``formula`` holds at some instant of a window."""
    return Eventually(formula, window(within, between))


def until(formula: Formula, goal: Formula, within: Any = None, between: Any = None) -> Until:
    """Return the formula that ``goal`` comes in a window and ``formula`` holds until then."""
    return Until(formula, goal, window(within, between))


def unless(formula: Formula, goal: Formula) -> Until:
    """Return the formula that ``formula`` holds until ``goal`` comes, or always."""
    return Until(formula, goal, WHOLE, True)


def after(trigger: Formula, formula: Formula) -> After:
    """Return the formula that ``formula`` holds at each instant of ``trigger``."""
    return After(trigger, formula)


def count(
    event: Event,
    operator: str,
    number: float,
    within: Any = None,
    between: Any = None,
    until: Formula | None = None,
) -> Count:
    """Return the comparison of the number of events in a window, or before ``until`` holds."""
    return Count(event, operator, float(number), window(within, between), until)


def quantile(
    share: float,
    of: Signal,
    operator: str,
    number: str | float,
    within: Any = None,
    between: Any = None,
) -> Quantile:
    """Return the comparison of a quantile of a signal's messages in a window."""
    return Quantile(float(share), of, operator, to_number(number), window(within, between))
