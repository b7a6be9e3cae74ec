"""Readers of the signals of a bag's page."""

from viewer.recorded_bags import SECOND, write_forces

import rpud_sim.bag
from rpud_sim.bag.messages import blocks_of
from rpud_sim.viewer.signals import topic_readers


def test_messages_whose_times_need_64_bits_are_counted_as_unreadable(tmp_path):
    path = write_forces(tmp_path / "bag", [(SECOND, SECOND, 1.5), (2 * SECOND, 0, 2.5)])
    with rpud_sim.bag.open(path) as bag:
        [reader] = topic_readers(bag)[0].values()
        first, second = bag.messages()
    [block] = blocks_of([first, second._replace(log_time=2**63)])
    rows = reader.read(block)
    assert rows.values["force"].tolist() == [1.5]
    assert reader.unreadable == 1
