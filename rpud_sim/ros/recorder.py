"""The recorder: `rpud record`, and the executable `recorder` of `ros2 run`."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Iterable

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from rpud_sim.bag import BagError, BagWriter
from rpud_sim.bag.losses import RECORD_NAME, losses_to_record
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST_RECORD
from rpud_sim.bag.manifest import Manifest
from rpud_sim.bag.recovery import RECORDING_RECORD
from rpud_sim.ros.arguments import add_record_arguments
from rpud_sim.ros.drill_inquiry import DrillInquiry
from rpud_sim.ros.progress import ProgressLine
from rpud_sim.ros.qos_overrides import QosOverrideError, read_qos_overrides
from rpud_sim.ros.recorder_node import Recorder
from rpud_sim.ros.recording import MessageQueue, NamedRecord, WritingThread
from rpud_sim.ros.selection import TopicSelection
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
        rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
        try:
            return _record(arguments, stop)
        except NameValidationException as error:
            what, name, *_ = str(error).splitlines()  # below them it points at the character
            return _fail(f"{what} {name.strip()}", 2)
        except QosOverrideError as error:
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
    messages = MessageQueue()
    overrides: dict[str, QoSProfile] = {}
    if arguments.qos_profile_overrides_path is not None:
        overrides = read_qos_overrides(arguments.qos_profile_overrides_path)
    selection = TopicSelection(
        arguments.topics, arguments.regex, arguments.exclude, arguments.everything
    )
    node = Recorder(messages, selection, arguments.namespace, overrides)
    inquiry = DrillInquiry(node, node.wants_drill, sys.argv)
    with BagWriter(arguments.out, compression=arguments.compression) as bag:
        bag.add_record(RECORDING_RECORD, {"max_loss": str(arguments.max_loss)})
        writing = WritingThread(messages, bag, arguments.max_loss, stop.request)
        writing.start()
        if arguments.until_eof:
            threading.Thread(target=_wait_for_eof, args=(stop,), daemon=True).start()
        began = time.monotonic()
        try:
            with ProgressLine(bag.path.name) as progress:
                _collect(node, inquiry, messages, bag, stop, arguments.duration, progress)
            _drain(node)
            node.finish()
            _keep(messages, inquiry.finish())
        finally:
            messages.close()
            writing.join()
        if writing.error is None:
            bag.add_record(RECORD_NAME, losses_to_record(node.losses))
            if node.skipped:
                bag.add_record(SKIPPED_RECORD, node.skipped)
    if writing.error is not None:
        raise writing.error
    print(_summary(node, bag, time.monotonic() - began), flush=True)
    if writing.exposure > arguments.max_loss:
        print(
            f"a crash might have cost {writing.exposure:.1f} s, more than --max-loss "
            f"{arguments.max_loss:g} s: the disk was too slow",
            flush=True,
        )
    return 0


def _wait_for_eof(stop: StopRequest) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    stop.request()


def _collect(
    node: Recorder,
    inquiry: DrillInquiry,
    messages: MessageQueue,
    bag: BagWriter,
    stop: StopRequest,
    duration: float | None,
    progress: ProgressLine,
) -> None:
    began = time.monotonic()
    looked = float("-inf")
    ready_at = began + _DISCOVERY
    ready = False
    losses = node.losses
    while not stop.requested:
        now = time.monotonic()
        if now >= looked + _GRAPH_PERIOD:
            looked = now
            if any(item.total != 0 for item in node.losses.values()) and node.losses != losses:
                # They are in the bag before its end, should that never come.
                losses = node.losses
                messages.keep(NamedRecord(RECORD_NAME, losses_to_record(losses)))
            inquiry.look()
            if node.discover() and not ready:
                ready_at = now if node.complete else now + _SETTLING
        more = node.take()
        _keep(messages, inquiry.poll())
        if not ready and now >= ready_at:
            ready = True
            node.get_logger().info(f"recording {node.topic_count} topics to {bag.path}")
        if duration is not None and now >= ready_at + duration:
            return
        if progress.is_due:
            lost = sum(losses.total or 0 for losses in node.losses.values())
            progress.show(f"{now - began:.0f} s, {node.taken} messages, {lost} lost")
        if not more:
            stop.wait(_TAKE_PERIOD)


def _keep(messages: MessageQueue, manifests: Iterable[Manifest]) -> None:
    for manifest in manifests:
        messages.keep(NamedRecord(MANIFEST_RECORD, manifest.to_record()))


def _drain(node: Recorder) -> None:
    """Take all that the middleware had received when the stop came, or receives right after it."""
    time.sleep(_DRAIN)
    until = time.time_ns()
    while node.take(until):
        pass


def _summary(node: Recorder, bag: BagWriter, seconds: float) -> str:
    lines = [
        f"recorded {bag.message_count} messages on {node.topic_count} topics in {seconds:.1f} s "
        f"({bag.size / 1e6:.2f} MB) to {bag.path}"
    ]
    for name, losses in sorted(node.losses.items()):
        if losses.total is None:
            lines.append(f"losses on {name} are unknown: the middleware does not number messages")
        elif losses.total:
            lines.append(
                f"lost {losses.total} messages on {name}: {losses.transport} on the way, "
                f"{losses.queue} as the disk was too slow"
            )
    lines += [f"not recorded: {name}: {reason}" for name, reason in sorted(node.skipped.items())]
    return "\n".join(lines)


def _fail(message: str, code: int) -> int:
    print(f"rpud record: {message}", file=sys.stderr)
    return code
