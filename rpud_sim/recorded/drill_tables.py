"""Tables of a drill's messages that are in no bag."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np

from rpud_sim.bag import Topic, TopicSummary
from rpud_sim.bag.tables import Table
from rpud_sim.messages.batch import Batch
from rpud_sim.messages.definitions import find_definition
from rpud_sim.simulation.topics import TOPICS


@cache
def drill_table(type_name: str) -> Table:
    """Return the table of a type of the drill."""
    topic = Topic("", type_name)
    return Table(TopicSummary(topic, 0, None, None, find_definition(type_name)))


@cache
def field_units() -> dict[str, dict[str, str]]:
    """Return SI units of the fields of the drill's topics, by topic and field."""
    tables = {name: drill_table(topic.type).columns for name, topic in TOPICS.items()}
    return {name: {c.name: c.unit for c in found if c.unit} for name, found in tables.items()}


def rows_of(topic: str, batches: Iterable[Batch]) -> dict[str, np.ndarray]:
    """Return the columns of a topic's messages."""
    table = drill_table(TOPICS[topic].type)
    parts = [table.batch(batch).columns for batch in batches] or [table.empty().columns]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
