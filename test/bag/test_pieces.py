"""Parts of a bag that can be read by themselves, and files that were not closed."""

import pytest
from sample_bags import TALK, write_bag

import rpud_sim.bag
from rpud_sim.bag import BagFormatError
from rpud_sim.bag.message_block import messages_of


def everything(bag):
    return [message for piece in bag.pieces() for message in messages_of([*piece.blocks(None)])]


def test_all_parts_together_hold_every_message_once(tmp_path):
    path = write_bag(tmp_path / "bag", 500, chunk_size=2000)
    with rpud_sim.bag.open(path) as bag:
        pieces = bag.pieces()
        assert len(pieces) > 5
        assert everything(bag) == [*bag.messages()]
        for piece in pieces:
            times = [time for block in piece.blocks({TALK.name}) for time in block.log_times]
            assert (piece.start_time, piece.end_time) == (times[0], times[-1])
            assert piece.topics == {TALK.name}
            assert [*piece.blocks({"/other"})] == []


@pytest.mark.parametrize("part", [0.3, 0.6, 0.95])
def test_a_file_that_was_cut_off_is_read_up_to_there(tmp_path, part):
    path = write_bag(tmp_path / "bag", 500, chunk_size=2000)
    with rpud_sim.bag.open(path) as bag:
        whole = [*bag.messages()]
    file = next(path.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[: int(part * file.stat().st_size)])
    with pytest.raises(BagFormatError, match="cut off"):
        rpud_sim.bag.open(path)
    with rpud_sim.bag.open(path, unclosed=True) as bag:
        assert bag.unclosed == (file,)
        found = everything(bag)
        assert found == whole[: len(found)]
        assert len(found) == bag.message_count > 0
        assert [*bag.messages()] == found
        (talk,) = [each for each in bag.topics if each.topic.name == TALK.name]
        assert talk.message_count == len(found)
        assert talk.first_time == found[0].log_time
        assert talk.last_time <= found[-1].log_time  # the index of the last chunk may be missing


def test_a_whole_file_is_none_that_was_cut_off(tmp_path):
    with rpud_sim.bag.open(write_bag(tmp_path / "bag"), unclosed=True) as bag:
        assert bag.unclosed == ()
