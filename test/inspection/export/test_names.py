"""Every topic has a file of its own, inside the folder."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.inspection.export.names import file_stem


def test_names_of_ros_stay_readable():
    assert file_stem("/rpud/contact_force") == "rpud.contact_force"
    assert file_stem("/clock") == "clock"


@pytest.mark.parametrize(
    "topic", ["../../etc/passwd", "/a/../b", "/", "", "a\0b", "C:\\x", "/a b", ".", "x" * 9999]
)
def test_hostile_names_are_one_plain_name(topic):
    stem = file_stem(topic)
    assert stem.startswith("topic-")
    assert not set(stem) & set("/\\\0: ")
    assert len(stem) < 220


@given(st.text(), st.text())
def test_no_two_topics_have_the_same(one, other):
    assert (file_stem(one) == file_stem(other)) == (one == other)


def test_names_that_only_look_alike_differ():
    names = ["/a/b", "a/b", "/a.b", "a.b", "/a//b", "/a/b/", "/A/b", "a%2Fb", "topic-a"]
    assert len({file_stem(name) for name in names}) == len(names)
