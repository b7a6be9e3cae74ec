"""Picture of a flow, such as of power: from where it comes on the left, to where it goes.

Bands are as wide as their amounts. It is an SVG, whose colours follow the page.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping

from markupsafe import Markup

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.theme import series_color

_WIDTH, _TOP = 620, 30
_BAR = (302, 318)  # left and right side of the bar in the middle
_REACH = 95  # length of a band
_WHOLE = 190  # height of the bar
_LINE = 17  # height of a line of text
_LABEL = 24  # characters
_SHOWN = 1e-6  # share of the whole below which a flow has no band


def flow_picture(
    into: Mapping[str, float], out: Mapping[str, float], unit: str, alt: str
) -> Markup:
    """Return the picture of a flow as an element of a page.

    Amounts that come in and go out, by their names, are positive. ``alt`` says what is seen.
    """
    whole = max(sum(into.values()), sum(out.values()), 1e-300)
    parts = []
    height = float(_TOP + _WHOLE)
    first = 0
    for side, group in ((-1, into), (1, out)):
        shown = {name: value for name, value in group.items() if value > _SHOWN * whole}
        for part, bottom in _bands(side, shown, whole, first, unit):
            parts.append(part)
            height = max(height, bottom)
        first += len(shown)
    bar = Markup(
        '<rect x="{}" y="{}" width="{}" height="{}" fill="var(--muted)"/>'
        '<text x="{}" y="{}" text-anchor="middle" font-weight="600">{}</text>'
    ).format(
        _BAR[0], _TOP, _BAR[1] - _BAR[0], _WHOLE, _WIDTH // 2, _TOP - 10, f"{whole:.4g} {unit}"
    )
    return Markup(
        '<div class="wide" tabindex="0" role="region" aria-label="flow">'
        '<svg class="flow" role="img" aria-label="{}" viewBox="0 0 {} {}" font-size="14"'
        ' fill="var(--text)">{}{}</svg></div>'
    ).format(printable(alt), _WIDTH, round(height + 8), Markup("").join(parts), bar)


def _bands(
    side: int, group: Mapping[str, float], whole: float, first: int, unit: str
) -> Iterator[tuple[Markup, float]]:
    inner = float(_TOP)
    outer = 8.0
    start = _BAR[0] if side < 0 else _BAR[1]
    end = start + side * _REACH
    bend = start + side * _REACH // 2
    for number, (name, value) in enumerate(group.items(), first):
        width = _WHOLE * value / whole
        lines = [*textwrap.wrap(printable(name), _LABEL), f"{value:.4g} {unit}"]
        room = max(width, _LINE * len(lines))
        top = outer + 0.5 * (room - width)
        path = (
            f"M{start},{inner:.2f}C{bend},{inner:.2f} {bend},{top:.2f} {end},{top:.2f}"
            f"V{top + width:.2f}"
            f"C{bend},{top + width:.2f} {bend},{inner + width:.2f} {start},{inner + width:.2f}Z"
        )
        texts = Markup("").join(
            Markup('<tspan x="{}" y="{:.1f}">{}</tspan>').format(
                end + 8 * side,
                outer + 0.5 * room + _LINE * (place - 0.5 * len(lines) + 0.75),
                line,
            )
            for place, line in enumerate(lines)
        )
        yield (
            Markup(
                '<path class="band" d="{}" fill="var(--{})"/><text text-anchor="{}">{}</text>'
            ).format(path, series_color(number), "end" if side < 0 else "start", texts),
            outer + room,
        )
        inner += width
        outer += room + 8.0
