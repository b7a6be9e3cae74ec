"""Figures in the pages: written between markers from the results that are kept beside them."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from bench import results
from bench.checkout import ROOT
from bench.results import Part, number

PAGES = (ROOT / "docs/explanation/performance.md", ROOT / "README.md")
SHOWN = ROOT / "docs/explanation/performance.json"
"""Results that the pages show."""

_SPEED = re.compile(
    r"engine, (?P<regime>\w+): "
    r"(speed over that of (?P<other>.+)|simulated seconds per second, rpud_sim)"
)
_LATE = re.compile(r"telemetry, default: lateness of (blocks|(a|an ordinary) bare .*), p99[.]9")
_PROFILE = re.compile(r"profile, (?P<command>[^:]+): (?P<place>.+)")
_MARKED = re.compile(r"(<!-- figures: (\w+) -->\n)(.*?)(<!-- end of figures -->)", re.DOTALL)


def goals(parts: Sequence[Part]) -> Iterator[str]:
    """Yield the table of the figures that have goals."""
    yield from results.table([row for row in results.rows_of(parts) if row.goal is not None])


def missed(parts: Sequence[Part]) -> Iterator[str]:
    """Yield one line for each goal that is missed."""
    found = [row for row in results.rows_of(parts) if row.missed]
    if not found:
        yield "Every goal that was measured is met."
    for row in found:
        yield f"- {row.name}: {f'{number(row.median)} {row.unit}'.rstrip()}, goal {row.goal}"


def machine(parts: Sequence[Part]) -> Iterator[str]:
    """Yield what the results were measured on."""
    yield from results.heading(parts)


def speed(parts: Sequence[Part]) -> Iterator[str]:
    """Yield the table of the engine's speed, alone and over that of others, by regime."""
    found: dict[str, dict[str, float]] = {}
    for row in results.rows_of(parts):
        if matched := _SPEED.fullmatch(row.name):
            other = matched["other"]
            what = f"times as fast as {other}" if other else "simulated seconds in a second"
            found.setdefault(what, {})[matched["regime"]] = row.median
    if not found:
        yield "Not measured yet."
        return
    yield "| on one core | drilling | before drilling |"
    yield "|---|---|---|"
    for what, regimes in found.items():
        cells = (number(regimes[name]) if name in regimes else "" for name in ("drilling", "free"))
        yield f"| {what} | {' | '.join(cells)} |"


def profiles(parts: Sequence[Part]) -> Iterator[str]:
    """Yield a table of where commands spend their time, a line for each command."""
    found: dict[str, list[str]] = {}
    for row in results.rows_of(parts):
        if matched := _PROFILE.fullmatch(row.name):
            shares = found.setdefault(matched["command"], [])
            shares.append(f"{matched['place']} {number(row.median)} %")
    if not found:
        yield "Not measured yet."
        return
    yield "| command | share of its processor time |"
    yield "|---|---|"
    for command, shares in found.items():
        yield f"| {command} | {', '.join(shares)} |"


def lateness(parts: Sequence[Part]) -> Iterator[str]:
    """Yield the latest blocks of a node at its defaults, and of bare programs at the same time."""
    found = [row for row in results.rows_of(parts) if _LATE.fullmatch(row.name)]
    if not found:
        yield "Not measured yet."
        return
    yield "| 99.9 % are not later | ms |"
    yield "|---|---|"
    for row in found:
        what = row.name.split("lateness of ")[1].removesuffix(", p99.9")
        yield f"| {what} | {number(row.median)} |"
    for part in parts:
        if part.measurement == "telemetry" and part.stolen is not None:
            took = f"{part.stolen:.0f} % of the processor time"
            yield from ("", f"Other virtual machines took {took} meanwhile.")


SECTIONS: Mapping[str, Callable[[Sequence[Part]], Iterator[str]]] = {
    "goals": goals,
    "missed": missed,
    "machine": machine,
    "speed": speed,
    "profiles": profiles,
    "lateness": lateness,
}
"""Contents between markers such as ``<!-- figures: goals -->``."""


def filled(text: str, parts: Sequence[Part]) -> str:
    """Return the text of a page with every marked section replaced.

    Raises:
        KeyError: for a marker of no section.
    """

    def fill(found: re.Match[str]) -> str:
        lines = "\n".join(SECTIONS[found[2]](parts))
        return f"{found[1]}\n{lines}\n\n{found[4]}"

    return _MARKED.sub(fill, text)


def write_pages(folder: Path) -> int:
    """Keep the newest result of each measurement beside the pages, and write their figures.

    Args:
        folder: of the results.
    """
    newest = {part.measurement: part for part in results.newest_parts(folder)}
    former = results.read_parts(SHOWN) if SHOWN.is_file() else []
    for part in former:
        if part.measurement not in newest or newest[part.measurement].began < part.began:
            newest[part.measurement] = part
    parts = [newest[name] for name in sorted(newest) if not name.startswith("compare ")]
    if not parts:
        print(f"bench: no results in {folder}: run 'make bench' first", file=sys.stderr)
        return 1
    results.write_parts(SHOWN, parts)
    written = [SHOWN]
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        if (new := filled(text, parts)) != text:
            page.write_text(new, encoding="utf-8")
            written.append(page)
    print(f"written: {', '.join(str(each.relative_to(ROOT)) for each in written)}")
    return 0
