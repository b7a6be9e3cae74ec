"""A batch has the same columns from its fields as from its bytes, and the same bytes row by row."""

import numpy as np
import pytest
from same_bits import ARM

from rpud_sim.foundation.values import Sequences
from rpud_sim.messages.columns import FieldReader, columns_of
from rpud_sim.messages.definitions import find_definition, installed_codec
from rpud_sim.recorded.offline_bag import kept_topics, run_batches
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.topics import TOPICS


def values_of(column):
    if isinstance(column, Sequences):
        return [column.values.dtype, column.values.tobytes(), column.cuts.tolist()]
    return [column.dtype, column.tolist() if column.dtype == object else column.tobytes()]


@pytest.mark.parametrize("values", [{"regime": "free"}, ARM])
def test_fields_and_bytes_give_the_same(values):
    settings = to_settings(values)
    topics = kept_topics(settings.values())
    plan, end = Plan(Beginning(settings, 0.2)), 300_000_000
    found = set()
    for batch in (each for part in run_batches(plan, end, topics) for each in part):
        if batch.topic not in topics:
            continue
        found.add(batch.topic)
        name = TOPICS[batch.topic].type
        codec = installed_codec(name)
        block = batch.serialized(codec)
        assert block.serialized(codec) is block
        assert [block.message(n) for n in range(len(block))] == [
            codec.encode(batch.row(n)) for n in range(len(batch))
        ]
        reader = FieldReader(codec, columns_of(codec, find_definition(name)))
        one, other = reader.read(batch), reader.read(block)
        assert np.array_equal(one.rows, other.rows)
        assert one.columns.keys() == other.columns.keys()
        for column, own in one.columns.items():
            assert values_of(own) == values_of(other.columns[column]), (batch.topic, column)
    assert found >= {"contact_force", "joint_states", "journal", "status", "trajectory"} & {*topics}
