"""Counts of lost messages survive the bag."""

from rpud_sim.bag.losses import Losses, losses_from_record, losses_to_record


def test_round_trip():
    losses = {"/a": Losses(transport=3, queue=2), "/b": Losses(None, 1, damaged=4)}
    assert losses_from_record(losses_to_record(losses)) == losses


def test_the_total_is_unknown_if_the_transport_does_not_count():
    assert Losses(transport=3, queue=2).total == 5
    assert Losses(transport=3, queue=2, damaged=1).total == 6
    assert Losses(transport=None, queue=2).total is None


def test_a_record_without_damaged_messages_is_read_too():
    assert losses_from_record({"/a": '{"transport": 3, "queue": 2}'}) == {"/a": Losses(3, 2, 0)}
