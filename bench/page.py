"""Figures in the page: written between markers from the results that are kept beside them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from bench.table import Part, heading, number, read_parts, rows_of, table, write_parts

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "build/bench"
"""Folder of the newest result of each measurement, outside of git."""
SHOWN = ROOT / "docs/explanation/performance.json"
"""Results that the page shows."""
PAGE = ROOT / "docs/explanation/performance.md"

_SPEED = re.compile(
    r"engine, (?P<regime>\w+): "
    r"(speed over that of (?P<other>.+)|simulated seconds per second, rpud_sim)"
)
_MARKED = re.compile(r"(<!-- figures: (\w+) -->\n)(.*?)(<!-- end of figures -->)", re.DOTALL)


def _goals(parts: Sequence[Part]) -> Iterator[str]:
    """Yield the table of the figures that have goals."""
    yield from table(row for row in rows_of(parts) if row.goal is not None)


def _speed(parts: Sequence[Part]) -> Iterator[str]:
    """Yield the table of the engine's speed, by regime."""
    found: dict[str, dict[str, str]] = {}
    for row in rows_of(parts):
        if matched := _SPEED.fullmatch(row.name):
            other = matched["other"]
            what = f"times as fast as {other}" if other else "times real time"
            found.setdefault(what, {})[matched["regime"]] = number(row.median)
    yield "| on one core | drilling | before drilling |"
    yield "|---|---|---|"
    for what, regimes in found.items():
        yield f"| {what} | {regimes.get('drilling', '')} | {regimes.get('free', '')} |"


SECTIONS: Mapping[str, Callable[[Sequence[Part]], Iterator[str]]] = {
    "goals": _goals,
    "machine": heading,
    "speed": _speed,
}
"""Contents between markers such as ``<!-- figures: goals -->``."""


def filled(text: str, parts: Sequence[Part]) -> str:
    """Return the text of a page with every marked section replaced."""

    def fill(found: re.Match[str]) -> str:
        lines = "\n".join(SECTIONS[found[2]](parts))
        return f"{found[1]}\n{lines}\n\n{found[4]}"

    return _MARKED.sub(fill, text)


def write_page() -> None:
    """Keep the newest result of each measurement beside the page, and write its figures."""
    newest = {part.measurement: part for part in read_parts(SHOWN)}
    for file in sorted(KEPT.glob("*.json")):
        for part in read_parts(file):
            former = newest.get(part.measurement)
            if not part.failure and (former is None or former.began < part.began):
                newest[part.measurement] = part
    parts = [newest[name] for name in sorted(newest)]
    write_parts(SHOWN, parts)
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), parts), encoding="utf-8")
