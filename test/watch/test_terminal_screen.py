"""Lines on a terminal: what has changed is drawn, and nothing else."""

from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.watch.terminal_page import plain
from rpud_sim.watch.terminal_screen import changed_columns

LINES = st.lists(st.tuples(st.text("ab 鑽", max_size=5), st.sampled_from(("", "bold")))).map(tuple)


@given(before=LINES, after=LINES)
def test_only_columns_that_differ_are_drawn_and_all_of_them(before, after):
    def cells(line, length):
        cells = [(character, style) for text, style in line for character in text]
        return cells + [(" ", "")] * (length - len(cells))

    length = max(len(plain(before)), len(plain(after)))
    old, new = cells(before, length), cells(after, length)
    span = changed_columns(before, after)
    if span is None:
        assert old == new
        return
    first, end = span
    wide = "鑽" in plain(before) + plain(after)
    if wide:
        assert (first, end) == (0, 2 * length)
    else:
        assert old[:first] == new[:first]
        assert old[end:] == new[end:]
        assert old[first] != new[first]
        assert old[end - 1] != new[end - 1]
