"""``rpud compare``: two runs side by side."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import JSON, RUN, command
from rpud_sim.cli.program import ExitCode, print_result, progress_bar
from rpud_sim.foundation.options import SECONDS, option, positional
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import complain, printable, table

if TYPE_CHECKING:
    from rpud_sim.recorded.compare import Comparison

_PERCENT = Quantity("%", "a relative difference", 0.0, 100.0, exclusive=True, below=True)
_MOST_LINES = 40  # of a table of settings; the page and --json have all


def _each(name: str, metavar: str = "N") -> dict[str, Any]:
    return {"flag": f"--{name}", "action": "append", "metavar": metavar}


@command(
    "compare",
    "bags/before bags/after --tolerance 5 --out compare.html",
    "compare two runs: settings, commands, bits and distributions",
    "The first run is the reference. Exit codes: 0 no difference found, or all within the "
    "tolerance, 3 a figure differs or a part of a bag is damaged, 1 it cannot be decided or "
    "failed, 2 wrong call.",
    JSON,
    bag=positional("A", "bag of the reference: a folder or one MCAP file"),
    other=positional("B", "bag to compare with it"),
    begin=option(0.0, "compare figures from this simulation time on", SECONDS, flag="--from"),
    end=option(None, "up to this time (default: end of the shorter run)", SECONDS, flag="--to"),
    settle=option(0.5, "leave out so much after start, commands and faults", SECONDS),
    tolerance=option(None, "difference that does not matter: are they equivalent?", _PERCENT),
    run_numbers=option((), "run of a bag with several; once, or for each bag", RUN, **_each("run")),
    namespaces=option((), "drill of a bag with several, likewise", **_each("namespace", "NAME")),
    quantities=option(
        (), "compare only this, such as peak_force; repeatable", **_each("quantity", "NAME")
    ),
    out=option(None, "also write a page: a new HTML file", metavar="FILE"),
)
def _run(options: Any) -> int:
    from rpud_sim.recorded.compare import compare
    from rpud_sim.recorded.compare.results import content

    if options.out:
        from rpud_sim.recorded.compare.page import write_page
        from rpud_sim.recorded.output import check_new_file

        check_new_file(options.out)
    names = ("begin", "end", "settle", "run_numbers", "namespaces", "quantities")
    with progress_bar(" messages", scaled=True) as bar:
        found = compare(
            [options.bag, options.other],
            tolerance=(options.tolerance or 0.0) / 100.0,
            report=bar.update,
            **{name: getattr(options, name) for name in names},
        )
    for warning in found.warnings:
        complain("rpud compare", warning)
    for name, parts in found.damaged.items():
        for part, reason in parts.items():
            complain("rpud compare", f"{name}: left out {part}: {reason}")
    if options.out:
        write_page(found, options.out)
    print_result(
        options, {**content(found), "out": options.out}, lambda: _lines(found, options.out)
    )
    if found.damaged or found.differs:
        return ExitCode.INCOMPLETE
    return ExitCode.FAILED if found.undecided and not found.equal_bits else ExitCode.DONE


def _lines(found: Comparison, page: str | None) -> Iterator[str]:
    from rpud_sim.recorded.compare.estimates import DIFFERS, UNDECIDED
    from rpud_sim.recorded.compare.results import (
        LETTERS,
        bits_line,
        figure_table,
        setting_tables,
    )

    for letter, name, run in zip(LETTERS, found.names, found.values, strict=True):
        where = f"{run.drill.namespace or '/'}, run {run.drill.number} of {run.drill.runs}"
        yield printable(f"{letter}  {name}: {where}, {run.begin:.6g} to {run.end:.6g} s")
    for _, head, rows in setting_tables(found):
        if rows:
            yield ""
            yield from table(head, rows[:_MOST_LINES], left=1)
        if len(rows) > _MOST_LINES:
            yield f"and {len(rows) - _MOST_LINES} more"
    yield ""
    yield printable(f"B: {bits_line(found.bits)}")
    for number, window in enumerate(found.windows):
        yield ""
        yield printable(f"{window.name}: {window.spans}")
        chosen = (
            each
            for each in found.differences
            if each.window == number
            and (each.figure == "mean" or each.decision in (DIFFERS, UNDECIDED))
        )
        _, head, rows = figure_table(chosen)
        yield from table(head, rows, left=2)
    yield ""
    yield found.verdict
    if page:
        yield f"page: {page}"
