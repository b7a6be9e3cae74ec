"""Widget that shows lines of text and draws only the characters that have changed."""

from __future__ import annotations

from collections.abc import Sequence

from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from rpud_sim.watch.terminal_page import Line, plain


class Lines(Widget):
    """Lines of text, the rest blank.

    A serial line carries some thousand characters a second. So a new line is compared with the
    one before, and only the columns that differ are drawn.
    """

    DEFAULT_CSS = "Lines { height: 1fr; }"

    def __init__(self) -> None:
        super().__init__()
        self._lines: list[Line] = []

    @property
    def text(self) -> str:
        """What it shows, without styles."""
        return "\n".join(map(plain, self._lines))

    def show(self, lines: Sequence[Line]) -> None:
        """Show lines, the first one at the top."""
        before, self._lines = self._lines, list(lines)
        blank: Line = ()
        for number in range(max(len(before), len(lines))):
            old = before[number] if number < len(before) else blank
            new = lines[number] if number < len(lines) else blank
            if span := changed_columns(old, new):
                first, end = span
                self.refresh(Region(first, number, end - first, 1))

    def render_line(self, y: int) -> Strip:
        """Return a line, filled or cut to the width."""
        base = self.rich_style
        line = self._lines[y] if y < len(self._lines) else ()
        segments = [Segment(text, base + Style.parse(style)) for text, style in line]
        return Strip(segments).adjust_cell_length(self.size.width, base)


def changed_columns(before: Line, after: Line) -> tuple[int, int] | None:
    """Return the first column that differs, and the first after the last one; None if none does."""
    old = [(character, style) for text, style in before for character in text]
    new = [(character, style) for text, style in after for character in text]
    if old == new:
        return None
    end = max(len(old), len(new))
    if cell_len(plain(before)) != len(old) or cell_len(plain(after)) != len(new):
        return 0, 2 * end  # a character may be two columns wide
    blank = (" ", "")
    old += [blank] * (end - len(old))
    new += [blank] * (end - len(new))
    differing = [column for column in range(end) if old[column] != new[column]]
    return (differing[0], differing[-1] + 1) if differing else None
