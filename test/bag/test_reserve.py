"""A bag is completed on a disk that another program has filled."""

import errno
import io
import os

import pytest
from sample_bags import START, STRING_DEFINITION, TALK

import rpud_sim.bag
from rpud_sim.bag import BagError, BagWriter, mcap_writer
from rpud_sim.bag.reserve import RESERVE_NAME, Reserve, ReservedFile

SIZE = 20_000  # bytes of a message


@pytest.fixture
def fill(monkeypatch):
    """Fill the disk: later writes have only the room of the reserve."""
    room = [None]

    class SmallDisk(io.FileIO):
        def write(self, data, /):
            if room[0] is None:
                return super().write(data)
            folder = os.path.dirname(self.name)
            free = room[0] - os.path.exists(os.path.join(folder, RESERVE_NAME)) * room[0]
            if free == 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            written = super().write(memoryview(data)[:free])
            room[0] -= written
            return written

    class File(ReservedFile, SmallDisk):
        pass

    monkeypatch.setattr(mcap_writer, "ReservedFile", File)

    def act(folder):
        reserve = folder / RESERVE_NAME
        room[0] = reserve.stat().st_blocks * 512 if reserve.exists() else 0

    return act


def write(bag, count):
    for number in range(count):
        if not bag.reserve(SIZE):
            return number
        bag.write(TALK.name, os.urandom(SIZE), START + number, START + number)
    return count


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_a_bag_is_whole_though_the_disk_is_full(tmp_path, fill, compression):
    path = tmp_path / "run"
    with BagWriter(path, compression=compression, reserved=True) as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        assert write(bag, 200) == 200
        fill(path)
        # The next chunk finds the disk full; what was accepted has its room, and no more is.
        count = 200 + write(bag, 1000)
        assert count < 300
        bag.flush()
        assert not bag.reserve(1)
        bag.add_record("notes", {"weather": "x" * 500_000})
    assert not (path / RESERVE_NAME).exists()
    with rpud_sim.bag.open(path) as whole:
        assert sum(1 for _ in whole.messages()) == count
        assert len(whole.records("notes")) == 1


def test_without_a_reserve_it_is_torn(tmp_path, fill):
    path = tmp_path / "run"
    with pytest.raises(BagError, match="No space left"), BagWriter(path) as bag:  # noqa: PT012
        bag.add_topic(TALK, STRING_DEFINITION)
        fill(path)
        write(bag, 200)
    with pytest.raises(BagError):
        rpud_sim.bag.open(path)


def test_room_that_no_disk_has_is_not_held_and_not_even_tried(tmp_path, monkeypatch):
    asked = []
    allocate = os.posix_fallocate
    monkeypatch.setattr(
        os, "posix_fallocate", lambda *words: asked.append(words) or allocate(*words)
    )
    reserve = Reserve(tmp_path)
    assert reserve.hold(1)
    size = (tmp_path / RESERVE_NAME).stat().st_blocks * 512
    assert size >= 1 << 20
    disk = os.statvfs(tmp_path)
    assert not reserve.hold(2 * disk.f_blocks * disk.f_frsize)
    assert len(asked) == 1  # or no other program could write meanwhile
    assert reserve.release()
    assert not (tmp_path / RESERVE_NAME).exists()
    assert not reserve.hold(1)
    assert not reserve.release()
