"""Commands on recorded bags: info, recover, verify, export, report, compare."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import BAG, JSON, RUN, command, run_number_option
from rpud_sim.cli.program import ExitCode, print_result, progress_bar
from rpud_sim.foundation.options import (
    SECONDS,
    duration_option,
    option,
    positional,
    required,
    start_option,
)
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.foundation.shown_quantities import NONE
from rpud_sim.foundation.terminal import (
    LONGEST_LINE,
    LONGEST_NAME,
    cell,
    print_error,
    printable,
    table,
)
from rpud_sim.foundation.time import SECOND, split_seconds

if TYPE_CHECKING:
    from rpud_sim.bag import Recovery
    from rpud_sim.recorded.compare import Comparison
    from rpud_sim.recorded.verify import Verification

# counts of messages
_COUNTS = ("equal", "different", "unexpected", "head", "missing", "tail", "before")
_FORMATS = ("parquet", "csv")
_RATE = Quantity("Hz", "of the samples", 1.0, 1e9, whole=True)  # time is whole nanoseconds


@command("info", "bags/first", "list a bag's topics, counts, rates, times and losses", "", BAG)
def _info(options: Any) -> int:
    """Print the content of a bag; in JSON times are integer nanoseconds."""
    from rpud_sim.bag import open as open_bag

    names = ("duration", "start_time", "end_time", "message_count", "size", "compression")
    with open_bag(options.bag) as bag:
        content: dict[str, Any] = {"path": str(bag.path)}
        content.update((name, getattr(bag, name)) for name in names)
        content["topics"] = [
            {
                "name": summary.topic.name,
                "type": ", ".join(summary.types),
                "message_count": summary.message_count,
                "rate": summary.rate,
                "losses": summary.losses.total if summary.losses else None,
            }
            for summary in bag.topics
        ]
        for text in bag.unread_offers:
            print_error("rpud info", text)
    print_result(options, content, lambda: _info_lines(content))
    return ExitCode.DONE


def _info_lines(content: dict[str, Any]) -> Iterator[str]:
    begin, end = (
        _moment(content[name]) if content["message_count"] else "-"
        for name in ("start_time", "end_time")
    )
    yield f"bag       {printable(content['path'])}"
    yield f"duration  {content['duration'] / SECOND:.3f} s"
    yield f"start     {begin}"
    yield f"end       {end}"
    yield f"messages  {content['message_count']}"
    size = f"{content['size'] / 1e6:.2f} MB"
    yield f"size      {size}, compression {printable(content['compression'], LONGEST_NAME)}"
    yield ""
    rows = [
        (name, kind, count, cell(rate, ".2f"), cell(lost, none="unknown"))
        for name, kind, count, rate, lost in (topic.values() for topic in content["topics"])
    ]
    yield from table(("topic", "type", "messages", "rate [Hz]", "lost"), rows, left=2)


def _moment(nanoseconds: int) -> str:
    seconds, rest = split_seconds(nanoseconds)
    moment = datetime.fromtimestamp(seconds, tz=timezone.utc)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"


@command(
    "recover",
    "bags/damaged --out bags/recovered",
    "make a complete bag from one that was cut off or damaged",
    "Exit codes: 0 nothing is lost, 3 recovered, and something is lost, 1 failed, 2 usage error.",
    JSON,
    torn=positional("TORN", "a bag's folder or one MCAP file; it is not changed"),
    out=required("the bag's new folder", metavar="DIR", new=True),
)
def _recover(options: Any) -> int:
    from rpud_sim.bag.recovery import files_to_recover, recover

    size = sum(file.stat().st_size for file in files_to_recover(options.torn).files)
    with progress_bar("B", size, scaled=True) as bar:
        recovery = recover(options.torn, options.out, bar.update)
    print_result(options, recovery.to_mapping(), lambda: _recovery_lines(recovery))
    return ExitCode.DONE if recovery.complete else ExitCode.INCOMPLETE


def _recovery_lines(recovery: Recovery) -> Iterator[str]:
    yield f"recovered {recovery.message_count} messages to {printable(recovery.path)}"
    yield ""
    rows = [
        (topic.name, topic.type, topic.recovered, topic.lost)
        for _, topic in sorted(recovery.topics.items())
    ]
    yield from table(("topic", "type", "recovered", "lost"), rows, left=2)
    yield ""
    for topic in recovery.topics.values():
        name, losses = printable(topic.name, LONGEST_NAME), topic.recording_losses
        if topic.unchecked:
            yield f"{topic.unchecked} messages on {name} have no checksum"
        if losses is not None and losses.total != 0:
            lost = cell(losses.total, none="unknown")
            yield f"lost before they were written on {name}: {lost}"
    for reason in recovery.damages:
        yield printable(reason, LONGEST_LINE)
    if recovery.damage_count > len(recovery.damages):
        yield f"... {recovery.damage_count} damaged places in all"
    if recovery.size_lost:
        yield f"{recovery.size_lost} bytes could not be read"
    if not recovery.closed:
        bound = cell(recovery.max_loss, "g", "")
        bound = bound and f", at most {bound} s if processor and disk kept up"
        yield f"not closed: what its recorder had yet to write is missing{bound}"
    if recovery.complete:
        yield "nothing is lost"


@command(
    "verify",
    "bags/first",
    "run a bag's simulation again and compare every message, bit for bit",
    "Exit codes: 0 proved, or incomplete and each message equal, 3 a message differs or, with "
    "--strict, is missing, 1 it cannot be decided or messages are missing at the end, "
    "2 usage error.",
    BAG,
    strict=option(
        False, "exit code 3 also if messages are missing before or between recorded ones"
    ),
)
def _verify(options: Any) -> int:
    from rpud_sim.recorded.verify import verify

    with progress_bar(" s") as bar:
        found = verify(options.bag, bar.update)
    for warning in found.warnings:
        print_error("rpud verify", warning)
    difference, topics = found.first_difference, sorted(found.topics.items())
    content = {
        "proved": found.proved,
        "simulated": found.simulated,
        "begins": found.begins,
        "topics": {n: {**dataclasses.asdict(each), "lost": found.lost[n]} for n, each in topics},
        "first_difference": dataclasses.asdict(difference) if difference else None,
        "undecided": found.undecided,
        "warnings": list(found.warnings),
    }
    print_result(options, content, lambda: _verification_lines(found))
    if found.undecided or found.total.tail:
        return ExitCode.INCOMPLETE if difference else ExitCode.FAILED
    wrong = difference or (options.strict and found.lacking)
    return ExitCode.INCOMPLETE if wrong else ExitCode.DONE


def _verification_lines(found: Verification) -> Iterator[str]:
    topics, total = sorted(found.topics.items()), found.total
    rows = [
        (name, *(getattr(each, n) for n in _COUNTS), cell(found.lost[name], none="unknown"))
        for name, each in topics
    ]
    yield from table(("topic", *_COUNTS, "lost"), rows, left=1)
    yield ""
    if difference := found.first_difference:
        at = f"{printable(difference.topic, LONGEST_NAME)} at {difference.stamp / SECOND:.9f} s"
        if difference.computed is None:
            yield f"first difference: {at} is a message that the simulation does not give"
        else:
            recorded, computed = (
                printable(each, LONGEST_NAME) for each in (difference.recorded, difference.computed)
            )
            what = f"{difference.field or 'the message'} is {recorded}, computed {computed}"
            yield f"first difference: {at}: {what}"
    for name, each in topics:
        if each.tail:
            shown = printable(name, LONGEST_NAME)
            yield f"{shown}: {each.tail} messages are missing at the end, while the drill continued"
    since = cell(found.begins and found.begins / SECOND, ".9f", "")
    since = since and f" from {since} s on, where its journal begins"
    if difference:
        verdict = "not proved: it differs"
    elif found.undecided:
        verdict = f"not decided: {found.undecided}"
    elif found.lacking:
        count = f"{total.equal:,} of {total.equal + found.lacking:,} messages"
        verdict = f"incomplete{since}: {count} were recorded, each equal"
    else:
        verdict = f"proved{since}: {total.equal} messages are equal bit for bit"
    yield f"{verdict}, {found.simulated / SECOND:.3f} s simulated again"


@command(
    "export",
    "bags/first --out tables",
    "write the topics of a bag as Parquet or CSV files",
    "It writes one table for each topic, and export.json with types, units, losses and the "
    "configuration of the run. With --rate it writes one table instead: every channel of the "
    "waveform, rebuilt exactly from the trajectory. Exit codes: 0 done, 3 done but for damaged "
    "parts, 1 failed, 2 usage error.",
    BAG,
    out=required("new folder for the files", metavar="DIR", new=True),
    format=option(_FORMATS[0], "of the files", choices=_FORMATS),
    topics=option(None, "export only these topics (absolute names)", nargs="+", metavar="TOPIC"),
    rate=option(None, "export the waveform, computed at this rate", _RATE),
    run=run_number_option("with --rate: "),
    start=start_option(),
    duration=duration_option("export"),
)
def _export(options: Any) -> int:
    if options.rate is None and options.run != 1:
        raise ParameterError("--run goes with --rate")
    where = options.bag, options.out
    part = options.format, options.topics, options.start, options.duration
    if options.rate is not None:
        from rpud_sim.recorded.rebuild import rebuild

        with progress_bar(" samples", scaled=True) as bar:
            rebuilt = rebuild(*where, options.rate, *part, options.run, bar.update)
        print_result(options, dataclasses.asdict(rebuilt), lambda: _rebuilt_lines(rebuilt))
        return ExitCode.DONE
    from rpud_sim.recorded.export import export

    with progress_bar(" messages", scaled=True) as bar:
        exported = export(*where, *part, bar.update)
    _complain_of_parts("rpud export", exported)
    head = ("topic", "messages", "rows", "size [MB]", "file")
    rows = [(t.name, t.messages, t.rows, f"{t.size / 1e6:.3f}", t.path) for t in exported.topics]
    print_result(options, dataclasses.asdict(exported), lambda: table(head, rows, left=1))
    return ExitCode.INCOMPLETE if exported.damaged else ExitCode.DONE


def _rebuilt_lines(rebuilt: Any) -> Iterator[str]:
    yield (
        f"rebuilt {rebuilt.count} samples at {rebuilt.rate} Hz in {printable(rebuilt.table)}: "
        f"{rebuilt.size / 1e6:.2f} MB"
    )
    yield f"the bag's trajectory is {rebuilt.trajectory_size / 1e6:.2f} MB uncompressed"
    if rebuilt.runs > 1:
        yield f"this is run {rebuilt.run} of {rebuilt.runs}, which resets began"
    if rebuilt.missing:
        yield f"{rebuilt.missing} samples are NaN: segments are missing"


@command(
    "report",
    "bags/first --out first.html",
    "write a report of a bag as one HTML page",
    "The page is the screen of `rpud watch`, with the whole run as an overview, some blocks of "
    "motion, and values by segment between commands and faults. It needs no other file and no "
    "network. Exit codes: 0 done, 3 done but for damaged parts, 1 failed, 2 usage error.",
    BAG,
    out=option("report.html", "new file", metavar="FILE", new=True),
    namespace=option("", "drill; default: the first", metavar="NAME"),
)
def _report(options: Any) -> int:
    from rpud_sim.viewer.report import write_report

    seen = write_report(options.bag, options.out, options.namespace)
    _complain_of_parts("rpud report", seen)
    said = f"{printable(options.out)}: {seen.messages} messages on {seen.topics} topics"
    print_result(options, {"out": options.out, **dataclasses.asdict(seen)}, lambda: [said])
    return ExitCode.INCOMPLETE if seen.damaged else ExitCode.DONE


def _complain_of_parts(program: str, written: Any) -> None:
    """Name what an export or a report leaves out."""
    for name, reason in (*written.left_out.items(), *written.damaged.items()):
        print_error(program, f"left out {printable(name, LONGEST_NAME)}: {reason}")


_PERCENT = Quantity("%", "a relative difference", 0.0, 100.0, exclusive=True, below=True)
_MOST_LINES = 40  # rows of a table of settings; the page and --json have all


def _each(name: str, metavar: str = "N") -> dict[str, Any]:
    return {"flag": f"--{name}", "action": "append", "metavar": metavar}


@command(
    "compare",
    "bags/before bags/after --tolerance 5 --out compare.html",
    "compare two runs: settings, metrics and bits",
    "The first run is the reference. Exit codes: 0 no difference found, or all within the "
    "tolerance, 3 a metric differs or a part of a bag is damaged, 1 it cannot be decided or "
    "failed, 2 usage error.",
    JSON,
    bag=positional("A", "bag of the reference: a folder or one MCAP file"),
    other=positional("B", "bag to compare with it"),
    begin=option(0.5, "compare metrics from this simulation time on", SECONDS, flag="--from"),
    end=option(None, "up to this time (default: end of the shorter run)", SECONDS, flag="--to"),
    tolerance=option(None, "relative difference that does not matter", _PERCENT),
    run_numbers=option((), "run of a bag with several; once, or for each bag", RUN, **_each("run")),
    namespaces=option(
        (), "drill of a bag with several; once, or for each bag", **_each("namespace", "NAME")
    ),
    quantities=option(
        (), "compare only this, such as peak_force; repeatable", **_each("quantity", "NAME")
    ),
    out=option(None, "also write a page: a new HTML file", metavar="FILE", new=True),
)
def _compare(options: Any) -> int:
    from rpud_sim.recorded.compare import compare

    if options.out:
        from rpud_sim.recorded.compare.page import write_page
        from rpud_sim.recorded.output import check_new_file

        check_new_file(options.out)
    names = ("begin", "end", "run_numbers", "namespaces", "quantities")
    with progress_bar(" messages", scaled=True) as bar:
        found = compare(
            [options.bag, options.other],
            tolerance=(options.tolerance or 0.0) / 100.0,
            report=bar.update,
            **{name: getattr(options, name) for name in names},
        )
    for warning in found.warnings:
        print_error("rpud compare", warning)
    for name, parts in found.damaged.items():
        for part, reason in parts.items():
            shown = printable(part, LONGEST_NAME)
            print_error("rpud compare", f"{name}: left out {shown}: {reason}")
    if options.out:
        write_page(found, options.out)
    content = {**found.content(), "out": options.out}
    print_result(options, content, lambda: _comparison_lines(found, options.out))
    if found.damaged or found.differs:
        return ExitCode.INCOMPLETE
    return ExitCode.FAILED if found.undecided else ExitCode.DONE


def _comparison_lines(found: Comparison, page: str | None) -> Iterator[str]:
    from rpud_sim.recorded.compare.comparison import METRIC_HEAD

    for letter, name, run in zip("AB", found.names, found.runs, strict=True):
        where = f"{run.drill.namespace or '/'}, run {run.drill.number} of {run.drill.runs}"
        yield printable(f"{letter}  {name}: {where}, {run.span or 'times unknown'}")
    if found.settings:
        yield ""
        rows = [
            (each.name, *(text or NONE for text in each.values), each.unit)
            for each in found.settings
        ]
        yield from table(("setting", "A", "B", "unit"), rows[:_MOST_LINES], left=1)
        if len(rows) > _MOST_LINES:
            yield f"and {len(rows) - _MOST_LINES} more"
    yield ""
    yield printable(f"B: {found.bits_line}")
    if found.metrics:
        yield ""
        yield from table(METRIC_HEAD, found.metric_rows, left=2)
    yield ""
    yield found.verdict
    if page:
        yield f"page: {page}"
