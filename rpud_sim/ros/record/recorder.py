"""Recording of ROS topics into a bag, until its duration is over or a signal stops it."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import NamedTuple

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException

from rpud_sim.bag import BagWriter
from rpud_sim.bag.losses import LOSSES_RECORD, RECORDING_RECORD, Losses, losses_to_record
from rpud_sim.bag.manifest import MANIFEST_RECORD, Manifest
from rpud_sim.foundation.quantities import suggestion
from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.record.parameter_query import ParameterQuery
from rpud_sim.ros.record.record_options import RecordOptions
from rpud_sim.ros.record.recorder_node import Recorder, RecorderServices
from rpud_sim.ros.record.writing import Intake, WritingThread
from rpud_sim.ros.starting import StartError, name_error, start_ros
from rpud_sim.ros.stopping import StopRequest

# Metadata record of topics that could not be recorded, with the reasons.
SKIPPED_RECORD = "rpud_skipped"

_POLL_PERIOD = 0.005  # s; messages carry the time at which the middleware received them
_GRAPH_PERIOD = 0.25  # s
_FIRST_GRAPH_PERIOD = 0.02  # s until it is ready: a topic is subscribed as soon as it is known
_DISCOVERY_TIME = 3.5  # s until it is ready; the middleware announces itself every 3 s
_SETTLING_TIME = 0.5  # s without a new topic until it is ready
_DRAIN_TIME = 0.1  # s in which messages on their way still arrive after a stop
_SHOW_PERIOD = 1.0  # of lines about the progress [s]


class RecordResult(NamedTuple):
    """Result of a recording."""

    summary: str  # what was recorded, lost and left out; lines of text
    failure: str  # why the bag is not as requested, in one line; empty where it is


def record(
    options: RecordOptions, ros_arguments: Sequence[str], show: Callable[[str], None]
) -> RecordResult:
    """Record until the duration is over or a signal stops it, and return the result.

    ``show`` is called with a line about the progress, once a second. A bag that cannot be written
    is a BagError, and ROS or a name that cannot be used a StartError.
    """
    with StopRequest(options.with_parent) as stop:
        try:
            start_ros(ros_arguments)
            return _record(options, stop, show)
        except NameValidationException as error:
            raise name_error(error) from error
        except ParameterException as error:
            raise StartError(str(error)) from error
        finally:
            rclpy.try_shutdown()


def _record(options: RecordOptions, stop: StopRequest, show: Callable[[str], None]) -> RecordResult:
    intake = Intake(options.max_cache_size, paused=options.start_paused)
    node = Recorder(intake, options)
    with BagWriter(
        options.out,
        compression=options.compression,
        max_file_size=options.max_bag_size,
        max_file_duration=options.max_bag_duration,
        reserved=True,
    ) as bag:
        bag.add_record(RECORDING_RECORD, {"max_loss": str(options.max_loss)})
        writing = WritingThread(intake, bag, options.max_loss, stop.request, options.max_disk)
        writing.start()
        if options.until_eof:
            threading.Thread(target=_wait_for_eof, args=(stop,), daemon=True).start()
        began = time.monotonic()
        try:
            query = ParameterQuery(node, sys.argv)
            _collect(node, query, bag, options, stop, show)
            if stop.orphaned:
                node.get_logger().warning("the process that started the recorder has ended")
            node.end()
            time.sleep(_DRAIN_TIME)
            node.receive_all()
            node.finish()
            _keep(intake, query.finish())
        finally:
            intake.close()
            writing.join()
        if writing.error is None:
            bag.add_record(LOSSES_RECORD, losses_to_record(node.losses))
            if node.skipped:
                bag.add_record(SKIPPED_RECORD, node.skipped)
    if writing.error is not None:
        raise writing.error
    text = summary(node, bag, time.monotonic() - began)
    if late := late_text(writing.exposure, options.max_loss):
        text = f"{text}\n{late}"
    if writing.refusal:
        return RecordResult(text, f"stopped with a whole bag: {writing.refusal}")
    return RecordResult(text, failure(node, allow_empty=options.allow_empty))


def _wait_for_eof(stop: StopRequest) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    stop.request()


def _collect(
    node: Recorder,
    query: ParameterQuery,
    bag: BagWriter,
    options: RecordOptions,
    stop: StopRequest,
    show: Callable[[str], None],
) -> None:
    """Record for the duration from when it is ready, or until the stop is requested."""
    services, progress, losses = RecorderServices(node), _Progress(), node.losses
    followed_at = float("-inf")
    ready_at = time.monotonic() + _DISCOVERY_TIME
    ready = False
    while not stop.requested:
        now = time.monotonic()
        if now >= followed_at + (_GRAPH_PERIOD if ready else _FIRST_GRAPH_PERIOD):
            followed_at = now
            losses = _keep_losses(node, losses)
            with node.guard("a node of the graph"):
                query.discover()
            with node.guard("a topic of the graph"):
                if node.discover() and not ready:
                    ready_at = now if node.complete else now + _SETTLING_TIME
        more = node.receive()
        services.serve()
        _keep(node.intake, query.poll())
        if not ready and now >= ready_at:
            ready = True
            node.get_logger().info(f"recording {node.topic_count} topics to {printable(bag.path)}")
            if options.ready_fd is not None:
                with suppress(OSError):  # that process may have ended
                    os.write(options.ready_fd, b"recording\n")
        if options.duration is not None and now >= ready_at + options.duration:
            return
        if now >= progress.shown + _SHOW_PERIOD:
            show(progress.text(node, bag.size))
        if not more:
            stop.wait(_POLL_PERIOD)


def _keep_losses(node: Recorder, before: dict[str, Losses]) -> dict[str, Losses]:
    """Write new losses into the bag now: a crash would lose those written at its end."""
    losses = node.losses
    if losses == before or not any(item.total != 0 for item in losses.values()):
        return before
    node.intake.add_record(LOSSES_RECORD, losses_to_record(losses))
    return losses


def _keep(intake: Intake, manifests: Iterable[Manifest]) -> None:
    for manifest in manifests:
        intake.add_record(MANIFEST_RECORD, manifest.to_record())


class _Progress:
    """Progress of a recording, as one line a second."""

    def __init__(self) -> None:
        self._began = self.shown = time.monotonic()
        self._count = 0
        self._size = 0

    def text(self, node: Recorder, size: int) -> str:
        """Return the progress so far, with rates since the last text; ``size`` in bytes."""
        now, count = time.monotonic(), node.intake.accepted
        period = max(now - self.shown, 1e-9)
        parts = [
            f"{now - self._began:.0f} s",
            f"{count} messages",
            f"{(count - self._count) / period:.0f}/s",
            f"{size / 1e6:.2f} MB",
            f"{(size - self._size) / period / 1e6:.2f} MB/s",
            f"{sum(item.total or 0 for item in node.losses.values())} lost",
            *(["paused"] if node.intake.paused else []),
        ]
        self.shown, self._count, self._size = now, count, size
        return ", ".join(parts)


def summary(node: Recorder, bag: BagWriter, seconds: float) -> str:
    """Return the summary of a recording that took that long [s]: recorded, lost, left out."""
    files = f" in {bag.file_count} files" if bag.file_count > 1 else ""
    lines = [
        f"recorded {bag.message_count} messages on {node.topic_count} topics in {seconds:.1f} s "
        f"({bag.size / 1e6:.2f} MB{files}) to {bag.path}"
    ]
    for name, losses in sorted(node.losses.items()):
        if losses.total is None:
            lines.append(f"losses on {name} are unknown: the middleware does not number messages")
        if losses.total != 0 and losses != Losses(None):
            lines.append(lost_text(name, losses))
    lines += [
        f"subscribed {name} again {count} times, in case a publisher was not heard"
        for name, count in sorted(node.renewals.items())
    ]
    if node.suppressed:
        lines.append(f"{node.suppressed} things that arrived could not be used; the log names one")
    lines += [f"not recorded: {name}: {reason}" for name, reason in sorted(node.skipped.items())]
    return "\n".join(map(printable, lines))


def lost_text(name: str, losses: Losses) -> str:
    parts = {
        "on the way": losses.transport,
        "for which the queue (--max-cache-size) had no room": losses.queue,
        "damaged": losses.damaged,
    }
    known = {what: count for what, count in parts.items() if count}
    causes = ", ".join(f"{count} {what}" for what, count in known.items())
    return f"lost {sum(known.values())} messages on {name}: {causes}"


def late_text(exposure: float, max_loss: float) -> str:
    """Return a warning if data reached the disk too late; empty if it did not.

    ``exposure`` is the longest time from the receipt of a message to the disk [s], ``max_loss`` the
    bound that was requested [s].
    """
    if exposure <= max_loss:
        return ""
    return (
        f"data was on the disk {exposure:.1f} s after it was received, {exposure - max_loss:.1f} s "
        f"later than --max-loss {max_loss:g} s allows: a crash might have cost as much"
    )


def failure(node: Recorder, *, allow_empty: bool) -> str:
    """Return why the bag is not as requested, in one line; empty if it is."""
    reasons = []
    known = [name for name, _ in node.get_topic_names_and_types()]
    if not allow_empty:
        if node.missing:
            named = (name + suggestion(name, known) for name in node.missing)
            reasons.append(f"never appeared: {', '.join(named)}")
        elif not node.taken:
            prefix = node.get_namespace()
            spaces = sorted({name.rpartition("/")[0] for name in known if name.count("/") > 1})
            hint = "" if node.topic_count else suggestion(prefix, spaces)
            reasons.append(f"nothing came on {node.topic_count} topics in {prefix}{hint}")
    if node.further_types:
        topics = ", ".join(node.further_types)
        reasons.append(f"topics with further types, which are not in the bag: {topics}")
    return "; ".join(reasons)
