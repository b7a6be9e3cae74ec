"""Recording of ROS topics into a bag, until its duration is over or a signal stops it."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from math import inf
from typing import NamedTuple

from rpud_sim.bag import BagWriter
from rpud_sim.bag.metadata import LOSSES_RECORD, RECORDING_RECORD, Losses, losses_to_record
from rpud_sim.foundation.quantities import did_you_mean
from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.options import RecordOptions
from rpud_sim.ros.process import StopRequest, running_ros
from rpud_sim.ros.record.drill_queries import JournalQuery, ParameterQuery
from rpud_sim.ros.record.recorder_node import Recorder
from rpud_sim.ros.record.writing import WriteQueue, WritingThread

# Metadata record of topics that could not be recorded, with the reasons.
SKIPPED_RECORD = "rpud_skipped"

_POLL_PERIOD = 0.005  # s; messages carry the time at which the middleware received them
_GRAPH_PERIOD = 0.25  # s between looks at what is known of each topic, when it is ready
_LOOK_PERIOD = 0.02  # s between looks for topics: one is subscribed as soon as it is known
_DISCOVERY_TIME = 3.5  # s until it is ready; the middleware announces itself every 3 s
_SETTLING_TIME = 0.5  # s without a new topic until it is ready
_DRAIN_TIME = 0.1  # s in which messages on their way still arrive after a stop
_JOURNAL_TIME = 10.0  # s that a drill may take to return further entries that are missing
_SHOW_PERIOD = 1.0  # of lines about the progress [s]


class RecordResult(NamedTuple):
    """Result of a recording."""

    summary: str  # what was recorded, lost and left out; lines of text
    failure: str  # why the bag is not as requested, in one line; empty where it is


def record(
    options: RecordOptions, ros_arguments: Sequence[str], show: Callable[[str], None]
) -> RecordResult:
    """Record until the duration is over or a signal; ``show`` gets a line each second."""
    with StopRequest(options.with_parent) as stop, running_ros(ros_arguments):
        return _record(options, stop, show)


def _record(options: RecordOptions, stop: StopRequest, show: Callable[[str], None]) -> RecordResult:
    intake = WriteQueue(options.max_cache_size, paused=options.start_paused)
    node = Recorder(intake, options)
    with BagWriter(
        options.out,
        compression=options.compression,
        max_file_size=options.max_bag_size,
        max_file_duration=options.max_bag_duration,
    ) as bag:
        bag.add_record(RECORDING_RECORD, _recording(options))
        writing = WritingThread(
            *(intake, bag, options.max_loss, stop.request, options.max_disk, options.min_free),
            node.clock,
        )
        writing.start()
        began = time.monotonic()
        try:
            query, journals = ParameterQuery(node, sys.argv), JournalQuery(node)
            _collect(node, query, journals, bag, options, stop, show)
            if stop.orphaned:
                node.get_logger().warning("parent process exited; shutting down")
            node.end()
            time.sleep(_DRAIN_TIME)
            node.receive_all()
            node.finish()
            query.finish()
            journals.finish(_JOURNAL_TIME)
        finally:
            ticked = node.clock.finish()
            intake.close()
            writing.join()
        if writing.error is not None:
            raise writing.error
        bag.add_record(LOSSES_RECORD, losses_to_record(node.losses))
        if skipped := node.skipped | dict.fromkeys(node.missing, "it never appeared"):
            bag.add_record(SKIPPED_RECORD, skipped)
    text = summary(node, bag, skipped, time.monotonic() - began)
    if (late := writing.exposure - options.max_loss) > 0.0:
        text += (
            f"\ndata was on the disk {writing.exposure:.1f} s after it was received, {late:.1f} s "
            f"later than --max-loss {options.max_loss:g} s allows: a crash might have cost as much"
        )
    if writing.refusal:
        return RecordResult(text, f"stopped with a whole bag: {writing.refusal}")
    reason = failure(node, allow_empty=options.allow_empty)
    if reason and not bag.message_count:
        bag.discard()  # it would be in the way of the corrected call
        return RecordResult("", f"{reason}: no bag is left")
    if not ticked:
        lacking = "nothing came on /clock, so log times are of this machine's clock"
        reason = "; ".join(filter(None, [reason, lacking]))
    return RecordResult(text, reason)


def _recording(options: RecordOptions) -> dict[str, str]:
    return {"max_loss": str(options.max_loss), "began": str(time.time_ns())}


def _collect(
    node: Recorder,
    query: ParameterQuery,
    journals: JournalQuery,
    bag: BagWriter,
    options: RecordOptions,
    stop: StopRequest,
    show: Callable[[str], None],
) -> None:
    """Record for the duration from when it is ready, or until the stop is requested."""
    progress, losses = _progress(node, bag), node.losses
    ready, ready_at = False, time.monotonic() + _DISCOVERY_TIME
    look_at = follow_at = -inf
    show_at = time.monotonic() + _SHOW_PERIOD
    while not stop.requested:
        now = time.monotonic()
        if now >= look_at:
            look_at = now + _LOOK_PERIOD
            if node.graph_changed:
                follow_at = now
        if now >= follow_at:
            rests = ready and (node.clock.decided or not node.taken)
            follow_at = now + (_GRAPH_PERIOD if rests else _LOOK_PERIOD)
            new_losses = node.losses
            if new_losses != losses and any(each.total != 0 for each in new_losses.values()):
                losses = new_losses  # into the bag now: a crash would cost those at its end
                node.intake.add_record(LOSSES_RECORD, losses_to_record(losses))
            with node.guard("a node of the graph"):
                query.discover()
            with node.guard("a topic of the graph"):
                if node.discover() and not ready:
                    ready_at = now if node.complete else now + _SETTLING_TIME
        done = node.receive()
        node.serve()
        query.poll()
        journals.poll()
        if not ready and now >= ready_at:
            ready = True
            if node.missing:
                node.get_logger().warning(f"not there yet: {_missing(node)}")
            node.get_logger().info(f"recording {len(node.topics)} topics to {printable(bag.path)}")
            if options.ready_fd is not None:
                with suppress(OSError):  # that process may have ended
                    os.write(options.ready_fd, b"recording\n")
        if options.duration is not None and now >= ready_at + options.duration:
            return
        if now >= show_at:
            show_at = now + _SHOW_PERIOD
            show(next(progress))
        if done == inf:
            stop.wait(_POLL_PERIOD)


def _progress(node: Recorder, bag: BagWriter) -> Generator[str, None, None]:
    """Yield the progress as one line, with rates since the line before."""
    began = before = time.monotonic()
    count = size = 0
    while True:
        now, new_count, new_size = time.monotonic(), node.intake.accepted, bag.size
        period = max(now - before, 1e-9)
        lost = sum(item.total or 0 for item in node.losses.values())
        yield (
            f"{now - began:.0f} s, {new_count} messages, {(new_count - count) / period:.0f}/s, "
            f"{new_size / 1e6:.2f} MB, {(new_size - size) / period / 1e6:.2f} MB/s, {lost} lost"
            f"{', paused' if node.intake.paused else ''}"
        )
        before, count, size = now, new_count, new_size


def summary(node: Recorder, bag: BagWriter, skipped: Mapping[str, str], seconds: float) -> str:
    """Return the summary of a recording that took that long [s]: recorded, lost, left out."""
    files = f" in {bag.file_count} files" if bag.file_count > 1 else ""
    lines = [
        f"recorded {bag.message_count} messages on {len(node.topics)} topics in {seconds:.1f} s "
        f"({bag.size / 1e6:.2f} MB{files}) to {bag.path}"
    ]
    for name, losses in sorted(node.losses.items()):
        lines += _lost(name, losses)
    lines += [
        f"subscribed {name} again {topic.renewals} times, in case a publisher was not connected"
        for name, topic in sorted(node.topics.items())
        if topic.renewals
    ]
    if node.suppressed:
        lines.append(f"{node.suppressed} things that arrived could not be used; the log names one")
    lines += [f"not recorded: {name}: {reason}" for name, reason in sorted(skipped.items())]
    return "\n".join(map(printable, lines))


def _lost(name: str, losses: Losses) -> list[str]:
    known = {
        "on the way": losses.transport or 0,
        "for which the queue (--max-cache-size) had no space": losses.queue,
        "damaged": losses.damaged,
    }
    causes = [f"{count} {what}" for what, count in known.items() if count]
    lines = [f"lost {sum(known.values())} messages on {name}: {', '.join(causes)}"] * bool(causes)
    if losses.total is None:
        lines.append(f"losses on {name} are unknown: the middleware does not number messages")
    return lines


def _missing(node: Recorder) -> str:
    """Return the requested topics that have not appeared, and the nearest ones there are."""
    known = [name for name, _ in node.get_topic_names_and_types()]
    hints = (did_you_mean(name, known, others=False) for name in node.missing)
    return ", ".join(node.missing) + "".join(hints)


def failure(node: Recorder, *, allow_empty: bool) -> str:
    """Return why the bag is not as requested, in one line; empty if it is."""
    reasons = []
    known = [name for name, _ in node.get_topic_names_and_types()]
    if not allow_empty and node.missing:
        reasons.append(f"never appeared: {_missing(node)}")
    elif not allow_empty and not node.taken:
        prefix = node.get_namespace()
        spaces = sorted({name.rpartition("/")[0] for name in known if name.count("/") > 1})
        hint = "" if node.topics else did_you_mean(prefix, spaces, others=False)
        reasons.append(f"nothing came on {len(node.topics)} topics in {prefix}{hint}")
    if twofold := sorted(name for name, types in node.further_types.items() if len(types) > 1):
        reasons.append(f"topics with further types, which are not in the bag: {', '.join(twofold)}")
    return "; ".join(reasons)
