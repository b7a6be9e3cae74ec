"""Page of a comparison: one HTML file in the style of all pages."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import numpy as np

from rpud_sim.foundation.shown_quantities import NONE
from rpud_sim.pages.frame import Picture, colors, picture, render_page
from rpud_sim.recorded.compare.comparison import METRIC_HEAD, Comparison
from rpud_sim.recorded.compare.metrics import DIFFERS
from rpud_sim.recorded.output import write_new_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROW = 19  # height of a row of the picture [pixels]
_BODY = """\
<p class="verdict">{{ found.verdict }}</p>
{% for line in warnings %}<p class="warning">{{ line }}</p>
{% endfor %}
<p>{% for letter, run in runs %}{{ letter }}: <code>{{ run.drill.path }}</code>, {{ run.span }}.
{% endfor %}</p>
<p>{{ found.bits_line }}.</p>
{% if drawn %}{{ figures([drawn]) }}{% endif %}
{{ table(head, found.metric_rows, caption="Metrics of both runs") }}
<p>All intervals together hold with a probability of 95 %. They come from the spread between 16
parts of the time, since impacts that follow each other are not independent.</p>
{{ table(["setting", "A", "B", "unit"], settings, caption="Settings that differ") }}
{{ table(["topic", "bits", "equal", "first difference [s]", "field", "in A", "in B", "note"], bits,
  caption="Bits") }}
"""


def write_page(found: Comparison, out: str | os.PathLike[str]) -> None:
    """Write settings, metrics, a picture of their differences, and bits of a comparison."""
    write_new_file(out, _render(found))


def _render(found: Comparison) -> str:
    skipped = ((name, *part) for name, parts in found.damaged.items() for part in parts.items())
    return render_page(
        _BODY,
        " and ".join(found.names),
        found=found,
        warnings=[*found.warnings, *(f"Left out: {': '.join(part)}" for part in skipped)],
        runs=[*zip("AB", found.runs, strict=True)],
        head=METRIC_HEAD,
        settings=[(s.name, *(text or NONE for text in s.values), s.unit) for s in found.settings],
        bits=[
            (
                *(each.topic, each.state, str(each.messages)),
                NONE if each.time is None else f"{each.time:.9f}",
                *(text[:80] for text in (each.field, each.reference, each.other, each.note)),
            )
            for each in found.bits
        ],
        drawn=_picture(found),
    )


def _picture(found: Comparison) -> Picture | None:
    """Return the relative intervals; None without any."""
    known = [
        (f"{row[0]}, {row[1]}", each)
        for row, each in zip(found.metric_rows, found.metrics, strict=True)
        if math.isfinite(each.relative_low)
    ]
    if not known:
        return None

    def draw(axes: Axes) -> None:
        if found.tolerance:
            edge = 100.0 * found.tolerance
            axes.axvspan(-edge, edge, color=colors()["muted"], alpha=0.16, label="tolerance")
        axes.axvline(0.0, color=colors()["text"], linewidth=1.3)
        ends = 100.0 * np.array([(each.relative_low, each.relative_high) for _, each in known])
        for differs, color in ((True, "series1"), (False, "muted")):
            rows = [r for r, (_, e) in enumerate(known) if (e.result == DIFFERS) is differs]
            if rows:
                label = "differs" if differs else "does not differ"
                middle, reach = ends[rows].mean(axis=1), np.ptp(ends[rows], axis=1) / 2
                axes.errorbar(
                    *(middle, rows, 0, reach, "o"), color=colors()[color], label=label, capsize=2
                )
        axes.set_xscale("symlog", linthresh=100.0)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_yticks(range(len(known)), [name for name, _ in known])
        axes.set_ylim(len(known) - 0.4, -0.6)
        axes.set_xlabel("difference [%]")

    count = sum(each.result == DIFFERS for _, each in known)
    alt = f"{count} of {len(known)} metrics differ from A."
    return picture(
        "Differences from A, with 95 % intervals", alt, draw, 90 + _ROW * len(known), 700
    )
