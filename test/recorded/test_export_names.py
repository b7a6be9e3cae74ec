"""Names of the files of an export."""

from hypothesis import example, given
from hypothesis import strategies as st

from rpud_sim.recorded.export import file_stem


@given(st.text(), st.text())
@example("/a/b", "/a.b")
@example("/a/b", "a.b")
@example("/a//b", "/a/b/")
@example("a/b", "a%2Fb")
def test_no_two_topics_have_the_same(one, other):
    assert (file_stem(one) == file_stem(other)) == (one == other)
