"""Tables of a drill's messages that are in no bag."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

from rpud_sim.bag import SerializedBatch, Topic, TopicSummary
from rpud_sim.bag.batches import joined
from rpud_sim.bag.definitions import find_definition
from rpud_sim.bag.tables import RowTable, Table
from rpud_sim.recorded.journal import installed_codec
from rpud_sim.recorded.offline_bag import encoded
from rpud_sim.simulation.batch import Batch
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


def serialized(batch: Batch) -> SerializedBatch:
    """Return messages of the drill as a bag has them whose times are simulation time."""
    return encoded(batch, installed_codec(TOPICS[batch.topic].type), "", 0)


def rows_of(topic: str, batches: Iterable[SerializedBatch]) -> RowTable:
    """Return the rows of a topic's messages, with their columns."""
    table, found = drill_table(TOPICS[topic].type), list(batches)
    return table.batch(joined(found)) if found else table.empty()
