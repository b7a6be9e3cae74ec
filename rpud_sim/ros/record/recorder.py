"""Recording of ROS topics into a bag, until its duration is over or a signal stops it."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException

from rpud_sim.bag import BagWriter
from rpud_sim.bag.losses import LOSSES_RECORD, RECORDING_RECORD, losses_to_record
from rpud_sim.bag.manifest import MANIFEST_RECORD, Manifest
from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.record.disk_room import DiskRoom
from rpud_sim.ros.record.drill_inquiry import DrillInquiry
from rpud_sim.ros.record.intake import Intake
from rpud_sim.ros.record.message_queue import MessageQueue, NamedRecord
from rpud_sim.ros.record.record_options import RecordOptions
from rpud_sim.ros.record.record_report import RecordProgress, failure, late_text, summary
from rpud_sim.ros.record.recorder_node import Recorder
from rpud_sim.ros.record.recorder_services import RecorderServices
from rpud_sim.ros.record.topic_selection import TopicSelection
from rpud_sim.ros.record.writing_thread import WritingThread
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


@dataclass(frozen=True)
class RecordResult:
    """Result of a recording."""

    summary: str  # what was recorded, lost and left out; lines of text
    failure: str  # why the bag is not as requested, in one line; empty where it is


def record(
    options: RecordOptions, ros_arguments: Sequence[str], show: Callable[[str], None]
) -> RecordResult:
    """Record until the duration is over or a signal stops it, and return the result.

    Args:
        show: called with a line about the progress, once a second.

    Raises:
        BagError: if the bag cannot be written.
        StartError: if ROS cannot start, or a name cannot be one of ROS.
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
    messages = MessageQueue(options.max_cache_size)
    intake = Intake(messages, paused=options.start_paused)
    selection = TopicSelection(options.topics, options.regex, options.exclude, options.everything)
    node = Recorder(intake, selection, options.namespace)
    with BagWriter(
        options.out,
        compression=options.compression,
        max_file_size=options.max_bag_size,
        max_file_duration=options.max_bag_duration,
        reserved=True,
    ) as bag:
        bag.add_record(RECORDING_RECORD, {"max_loss": str(options.max_loss)})
        room = DiskRoom(bag.path, options.max_disk)
        writing = WritingThread(messages, bag, options.max_loss, stop.request, room)
        writing.start()
        if options.until_eof:
            threading.Thread(target=_wait_for_eof, args=(stop,), daemon=True).start()
        began = time.monotonic()
        try:
            collection = _Collection(node, intake, messages, bag, stop, options.ready_fd)
            collection.run(options.duration, show)
        finally:
            messages.close()
            writing.join()
        if writing.error is None:
            bag.add_record(LOSSES_RECORD, losses_to_record(node.losses))
            if node.skipped:
                bag.add_record(SKIPPED_RECORD, node.skipped)
    if writing.error is not None:
        raise writing.error
    lines = [summary(node, bag, time.monotonic() - began)]
    if late := late_text(writing.exposure, options.max_loss):
        lines.append(late)
    if writing.refusal:
        return RecordResult("\n".join(lines), f"stopped with a whole bag: {writing.refusal}")
    return RecordResult("\n".join(lines), failure(node, allow_empty=options.allow_empty))


def _wait_for_eof(stop: StopRequest) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    stop.request()


class _Collection:
    def __init__(
        self,
        node: Recorder,
        intake: Intake,
        messages: MessageQueue,
        bag: BagWriter,
        stop: StopRequest,
        ready_fd: int | None,
    ) -> None:
        self._ready_fd = ready_fd
        self._node = node
        self._intake = intake
        self._messages = messages
        self._bag = bag
        self._stop = stop
        self._inquiry = DrillInquiry(node, node.guard, node.wants_drill, sys.argv)
        self._services = RecorderServices(node, node.guard, intake, lambda: _take_all(node))
        self._losses = node.losses

    def run(self, duration: float | None, show: Callable[[str], None]) -> None:
        """Record for a duration [s] from when it is ready, or until the stop is requested."""
        self._collect(duration, show)
        if self._stop.orphaned:
            self._node.get_logger().warning("the process that started the recorder has ended")
        _drain(self._node)
        self._node.finish()
        self._keep(self._inquiry.finish())

    def _collect(self, duration: float | None, show: Callable[[str], None]) -> None:
        node = self._node
        progress = RecordProgress()
        followed_at = float("-inf")
        ready_at = time.monotonic() + _DISCOVERY_TIME
        ready = False
        while not self._stop.requested:
            now = time.monotonic()
            if now >= followed_at + (_GRAPH_PERIOD if ready else _FIRST_GRAPH_PERIOD):
                followed_at = now
                self._keep_losses()
                with node.guard("a node of the graph"):
                    self._inquiry.discover()
                with node.guard("a topic of the graph"):
                    if node.discover() and not ready:
                        ready_at = now if node.complete else now + _SETTLING_TIME
            more = node.receive()
            self._services.serve()
            self._keep(self._inquiry.poll())
            if not ready and now >= ready_at:
                ready = True
                where = printable(self._bag.path)
                node.get_logger().info(f"recording {node.topic_count} topics to {where}")
                self._signal_ready()
            if duration is not None and now >= ready_at + duration:
                return
            if progress.is_due:
                count, paused = self._intake.accepted, self._intake.paused
                show(progress.text(count, self._bag.size, node.losses, paused))
            if not more:
                self._stop.wait(_POLL_PERIOD)

    def _signal_ready(self) -> None:
        if self._ready_fd is not None:
            with suppress(OSError):  # that process may have ended
                os.write(self._ready_fd, b"recording\n")

    def _keep_losses(self) -> None:
        """Write new losses into the bag now: a crash would lose those written at its end."""
        losses = self._node.losses
        if losses != self._losses and any(item.total != 0 for item in losses.values()):
            self._losses = losses
            self._messages.keep(NamedRecord(LOSSES_RECORD, losses_to_record(losses)))

    def _keep(self, manifests: Iterable[Manifest]) -> None:
        for manifest in manifests:
            self._messages.keep(NamedRecord(MANIFEST_RECORD, manifest.to_record()))


def _drain(node: Recorder) -> None:
    node.end()
    time.sleep(_DRAIN_TIME)
    _take_all(node)


def _take_all(node: Recorder) -> None:
    until = time.time_ns()
    while node.receive(until):
        pass
