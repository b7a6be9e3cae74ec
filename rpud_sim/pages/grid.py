"""Plots side by side: those over one quantity zoom together, as do plots over one time."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import Any

from markupsafe import Markup

from rpud_sim.pages.extent import axis_ends
from rpud_sim.pages.plot import Axis, Plot

_GRID = Markup('<div class="plots" style="--least:{least}em">{hosts}</div>')
_GROUP = Markup('<div class="plots-group">{controls}{plots}</div>')


@dataclasses.dataclass(frozen=True)
class GridGroup:
    """Plots of a grid that zoom together."""

    name: str  # of the group; empty if the plots have words, not numbers, along x
    plots: tuple[Plot, ...]  # with equal ends of x

    @property
    def x(self) -> Axis:
        """Axis that the plots share."""
        return self.plots[0].x


def grid_groups(name: str, plots: Sequence[Plot]) -> Iterator[GridGroup]:
    """Yield the plots in their order, by the quantity along x. The name is unique in its page."""
    keys = dict.fromkeys(map(_quantity, plots))
    for number, key in enumerate(keys, 1):
        group = tuple(plot for plot in plots if _quantity(plot) == key)
        if group[0].x.categories:
            yield GridGroup("", group)
            continue
        ends = list(itertools.chain.from_iterable(axis_ends(plot, "x") for plot in group))
        shared = dataclasses.replace(group[0].x, low=min(ends), high=max(ends))
        yield GridGroup(
            f"{name}-{number}", tuple(dataclasses.replace(plot, x=shared) for plot in group)
        )


def grid_html(hosts: Sequence[Markup], controls: Markup, least: float) -> Markup:
    """Return one group's element; ``least`` is a plot's width in the width of a letter."""
    plots = _GRID.format(least=least, hosts=Markup("").join(hosts))
    return _GROUP.format(controls=controls, plots=plots)


def _quantity(plot: Plot) -> Any:
    x = plot.x
    return x.label, x.unit, x.log, x.categories
