"""Tables and JSON on standard output."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from rpud_sim.foundation.terminal import printable


def table(head: Sequence[str], rows: Iterable[Sequence[Any]], left: int) -> list[str]:
    """Return the lines of a table, aligned and printable, ``left`` columns to the left."""
    cells = [[printable(cell) for cell in row] for row in (head, *rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if number < left else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]


def print_json(content: Any) -> None:
    print(json.dumps(content, indent=2))
