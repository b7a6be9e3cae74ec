"""``rpud compare``: runs side by side."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rpud_sim.cli.options import RUN, SECONDS, Number, add_json_argument
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.inspection.compare import Comparison
    from rpud_sim.inspection.compare.estimates import Difference
    from rpud_sim.inspection.compare.same_bits import TopicBits
    from rpud_sim.pages.quantities import Quantity as ShownQuantity

HELP = "compare runs: settings, commands, bits and distributions"
DETAILS = (
    "The first run is the reference. Exit codes: 0 no difference found, or all within the "
    "tolerance, 3 a figure differs or a part of a bag is damaged, 1 it cannot be decided or "
    "failed, 2 wrong call."
)
EXAMPLE = "rpud compare bags/before bags/after --tolerance 5 --out compare.html"

_PERCENT = Quantity("%", "a relative difference", 0.0, 100.0, exclusive=True, below=True)
_MOST_LINES = 40  # of commands or faults; the page and --json have all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("bag", metavar="A", help="bag of the reference: a folder or one MCAP file")
    parser.add_argument("others", metavar="B", nargs="+", help="bags to compare with it, up to 5")
    parser.add_argument(
        "--from",
        dest="begin",
        action=Number,
        quantity=SECONDS,
        default=0.0,
        metavar="S",
        help="compare distributions from this simulation time on (default: 0)",
    )
    parser.add_argument(
        "--to",
        dest="end",
        action=Number,
        quantity=SECONDS,
        metavar="S",
        help="compare distributions up to this simulation time (default: end of the shortest run)",
    )
    parser.add_argument(
        "--settle",
        action=Number,
        quantity=SECONDS,
        default=0.5,
        metavar="S",
        help="leave out so much time after the start, and after each command and fault "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--tolerance",
        action=Number,
        quantity=_PERCENT,
        metavar="PERCENT",
        help="relative difference that does not matter: decide whether runs are equivalent",
    )
    parser.add_argument(
        "--run",
        action=_Append,
        quantity=RUN,
        default=[],
        metavar="N",
        dest="run_numbers",
        help="run in a bag with several, from 1; give it once, or once for each bag",
    )
    parser.add_argument(
        "--namespace",
        action="append",
        default=[],
        metavar="NAME",
        dest="namespaces",
        help="drill in a bag with several; give it once, or once for each bag",
    )
    parser.add_argument(
        "--quantity",
        action="append",
        default=[],
        metavar="NAME",
        dest="quantities",
        help="compare only this quantity, such as peak_force; can be repeated (default: all)",
    )
    parser.add_argument("--out", metavar="FILE", help="also write a page: a new HTML file")
    add_json_argument(parser)


class _Append(Number):
    def __call__(self, parser, namespace, values, option_string=None):
        before = getattr(namespace, self.dest)
        super().__call__(parser, namespace, values, option_string)
        setattr(namespace, self.dest, [*before, getattr(namespace, self.dest)])


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.bag import BagError
    from rpud_sim.inspection import InspectionError
    from rpud_sim.inspection.compare import compare
    from rpud_sim.inspection.compare.content import content

    if arguments.out:
        from rpud_sim.inspection.compare.compare_page import write_page
        from rpud_sim.inspection.output import check_new_file

        with failing(InspectionError):
            check_new_file(arguments.out)
    with failing(BagError, InspectionError), progress_bar(" messages", scaled=True) as bar:
        found = compare(
            [arguments.bag, *arguments.others],
            begin=arguments.begin,
            end=arguments.end,
            settle=arguments.settle,
            tolerance=(arguments.tolerance or 0.0) / 100.0,
            run_numbers=arguments.run_numbers,
            namespaces=arguments.namespaces,
            quantities=arguments.quantities,
            report=bar.update,
        )
    for warning in found.warnings:
        complain("rpud compare", warning)
    for name, parts in found.damaged.items():
        for part, reason in parts.items():
            complain("rpud compare", f"{name}: left out {part}: {reason}")
    if arguments.out:
        with failing(InspectionError):
            write_page(found, arguments.out)
    if arguments.json:
        print_json({**content(found), "out": arguments.out})
    else:
        print("\n".join([*_lines(found), *([f"page: {arguments.out}"] if arguments.out else [])]))
    if found.damaged or found.differs:
        return ExitCode.INCOMPLETE
    return ExitCode.FAILED if found.undecided and not found.equal_bits else ExitCode.DONE


def _lines(found: Comparison) -> Iterator[str]:
    for number, name in enumerate(found.names):
        drill, values = found.drills[number], found.values[number]
        where = f"{drill.namespace or '/'}, run {drill.number} of {drill.runs}"
        yield printable(
            f"{_letter(number)}  {name}: {where}, {values.begin:.6g} to {values.end:.6g} s"
        )
    heads = [_letter(number) for number in range(len(found.names))]
    for title, settings in (("parameter", found.parameters), ("version", found.versions)):
        if settings:
            yield ""
            rows = [
                (each.name, *(value or "-" for value in each.values), each.unit)
                for each in settings
            ]
            yield from table((title, *heads, ""), rows, left=1)
    for title, events in (("command", found.commands), ("fault", found.faults)):
        if events:
            yield ""
            rows = [
                (each.text, *("-" if time is None else f"{time:.6f}" for time in each.times))
                for each in events[:_MOST_LINES]
            ]
            yield from table((title, *(f"{head} [s]" for head in heads)), rows, left=1)
            if len(events) > _MOST_LINES:
                yield f"and {len(events) - _MOST_LINES} more"
    yield ""
    for number, bits in enumerate(found.bits, 1):
        yield _bits_line(_letter(number), bits)
    yield from _figure_lines(found)
    yield ""
    yield found.verdict


def _letter(number: int) -> str:
    return chr(ord("A") + number)


def _bits_line(letter: str, bits: Sequence[TopicBits]) -> str:
    from rpud_sim.inspection.compare.same_bits import EQUAL, first_different

    if first := first_different(bits):
        what = f"{first.field} " if first.field else ""
        return printable(
            f"{letter}: bits differ from A from {first.time or 0.0:.9f} s on: {first.topic} {what}"
            f"is {first.other:.60}, in A {first.reference:.60}"
        )
    equal = [topic for topic in bits if topic.state == EQUAL]
    if equal:
        messages = sum(topic.messages for topic in equal)
        return f"{letter}: equal bits: all {messages} messages on {len(equal)} topics"
    return f"{letter}: no bits to compare"


def _figure_lines(found: Comparison) -> Iterator[str]:
    """Yield the first figure of each quantity, and all that differ or are undecided."""
    from rpud_sim.inspection.compare.estimates import DIFFERS, UNDECIDED

    for window in found.windows:
        yield ""
        spans = ", ".join(
            f"{begin:.6g} to {end:.6g} s"
            for begin, end in dict.fromkeys(
                zip(window.window.begins, window.window.ends, strict=True)
            )
        )
        yield printable(f"{window.window.name}: {spans}")
        rows = [
            _row(quantity.shown, _letter(number), each)
            for quantity in window.quantities
            for number, differences in enumerate(quantity.differences, 1)
            for place, each in enumerate(differences)
            if place == 0 or each.decision in (DIFFERS, UNDECIDED)
        ]
        head = ("quantity", "figure", "run", "A", "value", "difference", "95 % interval", "")
        yield from table(head, rows, left=3)


def _row(shown: ShownQuantity, letter: str, each: Difference) -> tuple[str, ...]:
    from rpud_sim.inspection.compare.wording import difference_texts

    values = (shown.text(each.reference.value), shown.text(each.other.value))
    texts = (*values, *difference_texts(shown, each))
    return (shown.label, each.figure, letter, *texts, each.decision)
