"""Check of expectations against the types in a bag, before its messages are read."""

from __future__ import annotations

import os
from collections.abc import Iterable

from rpud_sim.bag import open as open_bag
from rpud_sim.verdicts.expectation import Expectation
from rpud_sim.verdicts.names import DIAGNOSTICS, check_use, find_field
from rpud_sim.verdicts.record import bag_namespace
from rpud_sim.verdicts.units import ExpectationError
from rpud_sim.verdicts.vocabulary import Compare, Quantile, Says


def check_bag(
    path: str | os.PathLike[str],
    expectations: Iterable[Expectation],
    namespace: str | None = None,
    file: str = "",
) -> None:
    """Check that the topics in a bag have the fields that expectations name.

    A topic that the bag does not hold is no error: its expectations are undecided.
    """
    with open_bag(path) as bag:
        known = {summary.topic.name for summary in bag.topics}
        space = bag_namespace(bag.topics, namespace).rstrip("/")
        for expectation in expectations:
            for part in expectation.formula.walk():
                if not isinstance(part, (Compare, Says, Quantile)):
                    continue
                topic = part.signal.topic
                name = topic if topic.startswith("/") else f"{space}/{topic}"
                if topic == DIAGNOSTICS or name not in known:
                    continue
                try:
                    check_use(part, find_field(part.signal.field, bag.columns(name), topic))
                except ExpectationError as error:
                    place = f"{file}: " if file else ""
                    raise ExpectationError(f"{place}{expectation.name}: {error}") from None
