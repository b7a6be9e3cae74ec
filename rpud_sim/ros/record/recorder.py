"""The recorder: `rpud record`, and the executable `recorder` of `ros2 run`."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Iterable
from contextlib import suppress

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.qos import QoSProfile
from rclpy.utilities import remove_ros_args

from rpud_sim.bag import BagError, BagWriter
from rpud_sim.bag.losses import RECORD_NAME, RECORDING_RECORD, losses_to_record
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST_RECORD
from rpud_sim.bag.manifest import Manifest
from rpud_sim.foundation.terminal import complain, printable
from rpud_sim.ros.arguments import MAX_CACHE_SIZE, add_record_arguments
from rpud_sim.ros.record.disk_room import DiskRoom
from rpud_sim.ros.record.drill_inquiry import DrillInquiry
from rpud_sim.ros.record.intake import Intake
from rpud_sim.ros.record.message_queue import MessageQueue, NamedRecord
from rpud_sim.ros.record.progress import ProgressLine
from rpud_sim.ros.record.qos_overrides import QosOverrideError, read_qos_overrides
from rpud_sim.ros.record.record_report import RecordProgress, failure, late_text, summary
from rpud_sim.ros.record.recorder_node import Recorder
from rpud_sim.ros.record.recorder_services import RecorderServices
from rpud_sim.ros.record.topic_selection import TopicSelection
from rpud_sim.ros.record.writing_thread import WritingThread
from rpud_sim.ros.starting import StartError, start_ros
from rpud_sim.ros.stopping import StopRequest

SKIPPED_RECORD = "rpud_skipped"
"""Metadata record of topics that could not be recorded, with the reasons."""

_TAKE_PERIOD = 0.005  # s; messages carry the time at which the middleware received them
_GRAPH_PERIOD = 0.25  # s
_DISCOVERY = 3.5  # s until it calls itself ready; the middleware announces itself every 3 s
_SETTLING = 0.5  # s without a new topic after which it calls itself ready
_DRAIN = 0.1  # s in which messages on their way still arrive after a stop


def run(arguments: argparse.Namespace, ros_arguments: list[str] | None = None) -> int:
    """Record until the duration is over or a signal asks to stop; give the exit code."""
    with StopRequest() as stop:
        try:
            start_ros(ros_arguments or [])
            return _record(arguments, stop)
        except NameValidationException as error:
            what, name, *_ = str(error).splitlines()  # below them it points at the character
            return _fail(f"{what} {name.strip()}", 2)
        except (QosOverrideError, ParameterException, StartError) as error:
            return _fail(str(error), 2)
        except BagError as error:
            return _fail(str(error), 1)
        finally:
            rclpy.try_shutdown()


def main() -> None:
    """Run the executable; ROS arguments follow `--ros-args`."""
    parser = argparse.ArgumentParser(prog="recorder", description=__doc__)
    add_record_arguments(parser)
    try:
        words = remove_ros_args(sys.argv)[1:]
    except RuntimeError as error:
        parser.error(str(error))
    sys.exit(run(parser.parse_args(words), sys.argv))


def _record(arguments: argparse.Namespace, stop: StopRequest) -> int:
    cache_size = int(arguments.max_cache_size)
    # A snapshot comes all at once, with what is latched beside it, and perhaps another behind it.
    waiting = max(2 * cache_size, MAX_CACHE_SIZE) if arguments.snapshot_mode else cache_size
    messages = MessageQueue(waiting)
    intake = Intake(
        messages,
        paused=arguments.start_paused,
        snapshot_size=cache_size if arguments.snapshot_mode else None,
    )
    node = _node(arguments, intake)
    with BagWriter(
        arguments.out,
        compression=arguments.compression,
        max_file_size=arguments.max_bag_size and int(arguments.max_bag_size),
        max_file_duration=arguments.max_bag_duration,
        reserved=True,
    ) as bag:
        bag.add_record(RECORDING_RECORD, {"max_loss": str(arguments.max_loss)})
        room = DiskRoom(bag.path, arguments.max_disk and int(arguments.max_disk))
        writing = WritingThread(messages, bag, arguments.max_loss, stop.request, room)
        writing.start()
        if arguments.until_eof:
            threading.Thread(target=_wait_for_eof, args=(stop,), daemon=True).start()
        began = time.monotonic()
        try:
            ready = arguments.ready_fd
            _Collection(node, intake, messages, bag, stop, ready).run(arguments.duration)
        finally:
            messages.close()
            writing.join()
        if writing.error is None:
            bag.add_record(RECORD_NAME, losses_to_record(node.losses))
            if node.skipped:
                bag.add_record(SKIPPED_RECORD, node.skipped)
    if writing.error is not None:
        raise writing.error
    print(summary(node, bag, time.monotonic() - began), flush=True)
    if late := late_text(writing.exposure, arguments.max_loss):
        print(late, flush=True)
    if writing.refusal:
        return _fail(f"stopped with a whole bag: {writing.refusal}", 1)
    if reason := failure(node, allow_empty=arguments.allow_empty):
        return _fail(reason, 1)
    return 0


def _node(arguments: argparse.Namespace, intake: Intake) -> Recorder:
    overrides: dict[str, QoSProfile] = {}
    if arguments.qos_profile_overrides_path is not None:
        overrides = read_qos_overrides(arguments.qos_profile_overrides_path)
    selection = TopicSelection(
        arguments.topics, arguments.regex, arguments.exclude, arguments.everything
    )
    return Recorder(intake, selection, arguments.namespace, overrides)


def _wait_for_eof(stop: StopRequest) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    stop.request()


class _Collection:
    """The loop that takes messages, follows the graph and serves requests, until the end."""

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

    def run(self, duration: float | None) -> None:
        """Record for `duration` [s] or until the stop is requested."""
        with ProgressLine(printable(self._bag.path.name)) as line:
            self._collect(duration, line)
        _drain(self._node)
        self._node.finish()
        self._keep(self._inquiry.finish())

    def _collect(self, duration: float | None, line: ProgressLine) -> None:
        node = self._node
        progress = RecordProgress()
        looked = float("-inf")
        ready_at = time.monotonic() + _DISCOVERY
        ready = False
        while not self._stop.requested:
            now = time.monotonic()
            if now >= looked + _GRAPH_PERIOD:
                looked = now
                self._keep_losses()
                with node.guard("a node of the graph"):
                    self._inquiry.discover()
                with node.guard("a topic of the graph"):
                    if node.discover() and not ready:
                        ready_at = now if node.complete else now + _SETTLING
            more = node.receive()
            self._services.serve()
            self._keep(self._inquiry.poll())
            if not ready and now >= ready_at:
                ready = True
                where = printable(self._bag.path)
                node.get_logger().info(f"recording {node.topic_count} topics to {where}")
                self._tell_ready()
            if duration is not None and now >= ready_at + duration:
                return
            if line.is_due and progress.is_due:
                count, paused = self._intake.accepted, self._intake.paused
                line.show(progress.text(count, self._bag.size, node.losses, paused))
            if not more:
                self._stop.wait(_TAKE_PERIOD)

    def _tell_ready(self) -> None:
        """Write one line to who started this one and waits for it."""
        if self._ready_fd is not None:
            with suppress(OSError):  # it may have ended
                os.write(self._ready_fd, b"recording\n")

    def _keep_losses(self) -> None:
        """Put new losses into the bag before its end, should that never come."""
        losses = self._node.losses
        if losses != self._losses and any(item.total != 0 for item in losses.values()):
            self._losses = losses
            self._messages.keep(NamedRecord(RECORD_NAME, losses_to_record(losses)))

    def _keep(self, manifests: Iterable[Manifest]) -> None:
        for manifest in manifests:
            self._messages.keep(NamedRecord(MANIFEST_RECORD, manifest.to_record()))


def _drain(node: Recorder) -> None:
    """Take all that the middleware had received when the stop came, or receives right after it."""
    time.sleep(_DRAIN)
    _take_all(node)


def _take_all(node: Recorder) -> None:
    until = time.time_ns()
    while node.receive(until):
        pass


def _fail(message: str, code: int) -> int:
    complain("rpud record", message)
    return code
