"""Commands on recorded bags: info, recover, verify, export, report."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import BagOptions, JsonOptions, command, run_number_option
from rpud_sim.cli.output import print_json, progress_bar, table
from rpud_sim.cli.program import ExitCode
from rpud_sim.foundation.options import (
    duration_option,
    option,
    positional,
    required,
    start_option,
)
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.foundation.terminal import complain, printable
from rpud_sim.foundation.time import SECOND, split_seconds

if TYPE_CHECKING:
    from rpud_sim.bag import Recovery
    from rpud_sim.inspection.export import Exported
    from rpud_sim.inspection.rebuild import Rebuilt
    from rpud_sim.inspection.verify.verification import Verification

_COUNTS = ("equal", "different", "unexpected", "missing", "tail", "before")  # of messages
_FORMATS = ("parquet", "csv", "numpy")
_RATE = Quantity("Hz", "of the samples", 1.0, 1e9, whole=True)  # time is whole nanoseconds


@command("info", "bags/first", "list a bag's topics, counts, rates, times and losses", BagOptions)
def _run_info(options: BagOptions) -> int:
    content = _info(options.bag)
    print_json(content) if options.json else print(_info_text(content))
    return ExitCode.DONE


def _info(path: str) -> dict[str, Any]:
    """Return the content of a bag: times in integer nanoseconds, size in bytes, rates in Hz."""
    from rpud_sim.bag import open as open_bag

    with open_bag(path) as bag:
        return {
            "path": str(bag.path),
            "duration": bag.duration,
            "start_time": bag.start_time,
            "end_time": bag.end_time,
            "message_count": bag.message_count,
            "size": bag.size,
            "compression": bag.compression,
            "topics": [
                {
                    "name": summary.topic.name,
                    "type": summary.topic.type,
                    "message_count": summary.message_count,
                    "rate": summary.rate,
                    "losses": summary.losses.total if summary.losses else None,
                }
                for summary in bag.topics
            ],
        }


def _info_text(content: dict[str, Any]) -> str:
    has_times = content["message_count"] > 0
    compression = printable(content["compression"])
    lines = [
        f"bag       {printable(content['path'])}",
        f"duration  {content['duration'] / SECOND:.3f} s",
        f"start     {_moment(content['start_time']) if has_times else '-'}",
        f"end       {_moment(content['end_time']) if has_times else '-'}",
        f"messages  {content['message_count']}",
        f"size      {content['size'] / 1e6:.2f} MB, compression {compression}",
        "",
    ]
    head = ("topic", "type", "messages", "rate [Hz]", "lost")
    rows = [
        (
            topic["name"],
            topic["type"],
            topic["message_count"],
            "-" if topic["rate"] is None else f"{topic['rate']:.2f}",
            "unknown" if topic["losses"] is None else topic["losses"],
        )
        for topic in content["topics"]
    ]
    return "\n".join(lines + table(head, rows, left=2))


def _moment(nanoseconds: int) -> str:
    seconds, rest = split_seconds(nanoseconds)
    moment = datetime.fromtimestamp(seconds, tz=timezone.utc)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"


@dataclass(frozen=True, kw_only=True)
class _Recover(JsonOptions):
    torn: str = positional("TORN", "a bag's folder or one MCAP file; it is not changed")
    out: str = required("the bag's new folder; nothing is overwritten", metavar="DIR")


@command(
    "recover",
    "bags/torn --out bags/whole",
    "make a whole bag of one that was cut off or damaged",
    _Recover,
    "Exit codes: 0 nothing is lost, 3 recovered, and something is lost, 1 failed, 2 wrong call.",
)
def _run_recover(options: _Recover) -> int:
    from rpud_sim.bag.recovery import files_to_recover, recover

    size = sum(file.stat().st_size for file in files_to_recover(options.torn))
    with progress_bar("B", size, scaled=True) as bar:
        recovery = recover(options.torn, options.out, bar.update)
    print_json(recovery.to_mapping()) if options.json else print(_recovery_text(recovery))
    return ExitCode.DONE if recovery.complete else ExitCode.INCOMPLETE


def _recovery_text(recovery: Recovery) -> str:
    lines = [f"recovered {recovery.message_count} messages to {printable(recovery.path)}", ""]
    head = ("topic", "type", "recovered", "lost", "gaps")
    rows = [
        (
            topic.name,
            topic.type,
            topic.recovered,
            topic.lost,
            "-" if topic.gaps is None else topic.gaps,
        )
        for _, topic in sorted(recovery.topics.items())
    ]
    lines += table(head, rows, left=2)
    lines.append("")
    for topic in recovery.topics.values():
        if topic.unchecked:
            lines.append(f"{topic.unchecked} messages on {printable(topic.name)} have no checksum")
        losses = topic.recording_losses
        if losses is not None and losses.total != 0:
            lost = "unknown" if losses.total is None else losses.total
            lines.append(f"lost before they were written on {printable(topic.name)}: {lost}")
    lines += map(printable, recovery.damages)
    if recovery.damage_count > len(recovery.damages):
        lines.append(f"... {recovery.damage_count} damaged places in all")
    if recovery.size_lost:
        lines.append(f"{recovery.size_lost} bytes could not be read")
    if not recovery.closed:
        bound = (
            ""
            if recovery.max_loss is None
            else (f", at most {recovery.max_loss:g} s if processor and disk kept up")
        )
        lines.append(f"not closed: what its recorder had yet to write is missing{bound}")
    if recovery.complete:
        lines.append("nothing is lost")
    return "\n".join(lines)


@dataclass(frozen=True, kw_only=True)
class _Verify(BagOptions):
    strict: bool = option(False, "exit code 3 also if messages are missing between recorded ones")


@command(
    "verify",
    "bags/first",
    "run a bag's simulation again and compare every message, bit for bit",
    _Verify,
    "Exit codes: 0 proved, 3 a message differs or, with --strict, is missing, 1 it cannot be "
    "decided or messages are missing at the end, 2 wrong call.",
)
def _run_verify(options: _Verify) -> int:
    from rpud_sim.inspection.verify.verification import verify

    with progress_bar(" s") as bar:
        found = verify(options.bag, bar.update)
    for warning in found.warnings:
        complain("rpud verify", warning)
    print_json(_verification(found)) if options.json else print(_verification_text(found))
    if found.proved:
        return ExitCode.INCOMPLETE if options.strict and found.total.missing else ExitCode.DONE
    return ExitCode.INCOMPLETE if found.first_difference else ExitCode.FAILED


def _verification(verification: Verification) -> dict[str, Any]:
    difference = verification.first_difference
    return {
        "proved": verification.proved,
        "simulated": verification.simulated,
        "begins": verification.begins,
        "topics": {
            name: {**dataclasses.asdict(counts), "lost": verification.lost[name]}
            for name, counts in sorted(verification.topics.items())
        },
        "first_difference": dataclasses.asdict(difference) if difference else None,
        "undecided": verification.undecided,
        "warnings": list(verification.warnings),
    }


def _verification_text(verification: Verification) -> str:
    head = ("topic", *_COUNTS, "lost")
    rows = [
        (
            name,
            *(getattr(counts, count) for count in _COUNTS),
            "unknown" if verification.lost[name] is None else verification.lost[name],
        )
        for name, counts in sorted(verification.topics.items())
    ]
    lines = [*table(head, rows, left=1), ""]
    difference = verification.first_difference
    if difference is not None:
        at = f"{printable(difference.topic)} at {difference.stamp / SECOND:.9f} s"
        if difference.computed is None:
            lines.append(f"first difference: {at} is a message that the simulation does not give")
        else:
            lines.append(
                f"first difference: {at}: {difference.field or 'the message'} "
                f"is {printable(difference.recorded)}, computed {printable(difference.computed)}"
            )
    lines.extend(
        f"{name}: {counts.tail} messages are missing at the end, while the drill went on"
        for name, counts in sorted(verification.topics.items())
        if counts.tail
    )
    lines.append(
        f"{_verdict(verification)}, {verification.simulated / SECOND:.3f} s simulated again"
    )
    return "\n".join(lines)


def _verdict(verification: Verification) -> str:
    total = verification.total
    if verification.proved:
        begins = verification.begins
        since = (
            "" if begins is None else f" from {begins / SECOND:.9f} s on, where its journal begins"
        )
        lacking = f", and {total.missing} are missing" if total.missing else ""
        return f"proved{since}: {total.equal} messages are equal bit for bit{lacking}"
    if verification.first_difference:
        return "not proved: it differs"
    if verification.undecided:
        return f"not decided: {verification.undecided}"
    return f"not proved: {total.equal} messages are equal bit for bit, and {total.tail} are missing"


@dataclass(frozen=True, kw_only=True)
class _Export(BagOptions):
    out: str = required("new folder for the files", metavar="DIR")
    format: str = option(_FORMATS[0], "of the files (default: %(default)s)", choices=_FORMATS)
    topics: Sequence[str] | None = option(
        None, "export only these topics (absolute names)", nargs="+", metavar="TOPIC"
    )
    rate: int | None = option(
        None, "export the waveform, rebuilt at this whole number of samples a second", _RATE
    )
    run: int = run_number_option("with --rate: ")
    start: float = start_option()
    duration: float | None = duration_option("export")


@command(
    "export",
    "bags/first --out tables",
    "write the topics of a bag as Parquet, CSV or NumPy files",
    _Export,
    "It writes one table for each topic, and export.json with types, units, losses and the "
    "configuration of the run. With --rate it writes one table instead: every channel of the "
    "waveform, rebuilt exactly from the trajectory. Exit codes: 0 done, 3 done but for damaged "
    "parts, 1 failed, 2 wrong call.",
)
def _run_export(options: _Export) -> int:
    if options.rate is not None:
        return _export_waveform(options, options.rate)
    if options.run != 1:
        raise ParameterError("--run goes with --rate")
    from rpud_sim.inspection.export import export

    with progress_bar(" messages", scaled=True) as bar:
        exported = export(
            options.bag,
            options.out,
            options.format,
            options.topics,
            options.start,
            options.duration,
            bar.update,
        )
    _complain_of_parts("rpud export", exported)
    print_json(dataclasses.asdict(exported)) if options.json else print(_export_text(exported))
    return ExitCode.INCOMPLETE if exported.damaged else ExitCode.DONE


def _export_waveform(options: _Export, rate: int) -> ExitCode:
    from rpud_sim.inspection.rebuild import rebuild

    with progress_bar(" samples", scaled=True) as bar:
        rebuilt = rebuild(
            options.bag,
            options.out,
            rate,
            options.format,
            options.topics,
            options.start,
            options.duration,
            options.run,
            bar.update,
        )
    print_json(dataclasses.asdict(rebuilt)) if options.json else print(_rebuilt_text(rebuilt))
    return ExitCode.DONE


def _rebuilt_text(rebuilt: Rebuilt) -> str:
    lines = [
        f"rebuilt {rebuilt.count} samples at {rebuilt.rate} Hz in {printable(rebuilt.table)}: "
        f"{rebuilt.size / 1e6:.2f} MB",
        f"the bag's trajectory is {rebuilt.trajectory_size / 1e6:.2f} MB uncompressed",
    ]
    if rebuilt.runs > 1:
        lines.append(f"this is run {rebuilt.run} of {rebuilt.runs}, which resets began")
    if rebuilt.missing:
        lines.append(f"{rebuilt.missing} samples are NaN: segments are missing")
    return "\n".join(lines)


def _export_text(exported: Exported) -> str:
    head = ("topic", "messages", "rows", "size [MB]", "file")
    rows = [
        (topic.name, topic.messages, topic.rows, f"{topic.size / 1e6:.3f}", topic.path)
        for topic in exported.topics
    ]
    return "\n".join(table(head, rows, left=1))


@dataclass(frozen=True, kw_only=True)
class _Report(BagOptions):
    out: str = option("report.html", "new file (default: %(default)s)", metavar="FILE")
    namespace: str = option("", "drill; default: the first", metavar="NAME")


@command(
    "report",
    "bags/first --out first.html",
    "write a report of a bag as one HTML page",
    _Report,
    "The page is the screen of `rpud watch`, with the whole run as an overview, some blocks of "
    "motion, and values by segment between commands and faults. It needs no other file and no "
    "network. Exit codes: 0 done, 3 done but for damaged parts, 1 failed, 2 wrong call.",
)
def _run_report(options: _Report) -> int:
    from rpud_sim.viewer.report import write_report

    seen = write_report(options.bag, options.out, options.namespace)
    _complain_of_parts("rpud report", seen)
    if options.json:
        print_json({"out": options.out, **dataclasses.asdict(seen)})
    else:
        print(f"{printable(options.out)}: {seen.messages} messages on {seen.topics} topics")
    return ExitCode.INCOMPLETE if seen.damaged else ExitCode.DONE


def _complain_of_parts(program: str, written: Any) -> None:
    """Name what an export or a report leaves out."""
    for name, reason in (*written.left_out.items(), *written.damaged.items()):
        complain(program, f"left out {name}: {reason}")
