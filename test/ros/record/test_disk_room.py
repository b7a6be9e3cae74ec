"""A recorder stops before its bag is too large or the disk is full."""

import os

import pytest

from rpud_sim.bag import BagError
from rpud_sim.ros.record.disk_room import DiskRoom


def test_the_limit_holds_for_the_closed_bag(tmp_path):
    room = DiskRoom(tmp_path, 1000)
    assert room.refusal(900, 100) == ""
    assert room.refusal(900, 101) == "it has reached --max-disk 1000 bytes"


def test_without_a_limit_the_disk_is_one(tmp_path):
    disk = os.statvfs(tmp_path)
    free = disk.f_bavail * disk.f_frsize
    room = DiskRoom(tmp_path, None)
    assert room.refusal(0, 1) == ""
    # Between two looks the growth of the bag is known.
    assert f"the disk of {tmp_path} has" in room.refusal(2 * free, 1)
    assert f"the disk of {tmp_path} has" in DiskRoom(tmp_path, None).refusal(0, 2 * free)


def test_a_disk_that_is_gone_is_an_error(tmp_path):
    with pytest.raises(BagError, match="cannot look at"):
        DiskRoom(tmp_path / "gone", None).refusal(0, 1)
