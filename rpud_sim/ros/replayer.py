"""The replayer: `rpud replay`, and the executable `replayer` of `ros2 run`."""

from __future__ import annotations

import argparse
import sys
import time

import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

import rpud_sim.bag
from rpud_sim.bag import BagError, BagReader, TopicSummary
from rpud_sim.ros.arguments import add_replay_arguments
from rpud_sim.ros.progress import ProgressLine
from rpud_sim.ros.replayer_node import Replayer
from rpud_sim.ros.replaying import Timeline, with_ticks
from rpud_sim.ros.stopping import StopRequest

_DISCOVERY = 3.5  # s in which subscribers may turn up; the middleware announces itself every 3 s
_SETTLING = 0.2  # s from a publisher's match to the subscriber's own
_LOOK_PERIOD = 0.01  # s
_ACKNOWLEDGEMENT = 5.0  # s that reliable subscribers have after the last message
_LOOP_PAUSE = 0.1  # s between two passes, so that a bag of one message is no flood


class _UsageError(Exception):
    """Arguments do not fit the bag."""


def run(arguments: argparse.Namespace, ros_arguments: list[str] | None = None) -> int:
    """Replay until the end of the bag or until a signal asks to stop; give the exit code."""
    with StopRequest() as stop:
        try:
            with rpud_sim.bag.open(arguments.bag) as bag:
                topics = _chosen(bag, arguments)
                rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
                try:
                    return _replay(bag, topics, arguments, stop)
                finally:
                    rclpy.try_shutdown()
        except BagError as error:
            return _fail(str(error), 1)
        except _UsageError as error:
            return _fail(str(error), 2)


def main() -> None:
    """Run the executable; ROS arguments follow `--ros-args`."""
    parser = argparse.ArgumentParser(prog="replayer", description=__doc__)
    add_replay_arguments(parser)
    try:
        words = remove_ros_args(sys.argv)[1:]
    except RuntimeError as error:
        parser.error(str(error))
    sys.exit(run(parser.parse_args(words), sys.argv))


def _chosen(bag: BagReader, arguments: argparse.Namespace) -> list[TopicSummary]:
    """Check the arguments against the bag, and give the topics that have something to replay."""
    duration = bag.duration / 1e9
    if arguments.start > duration:
        raise _UsageError(
            f"--start is {arguments.start:g} s; it must be from 0 to {duration:.3f} s, "
            f"the duration of {bag.path}"
        )
    for name in arguments.topics or ():
        if name not in (summary.topic.name for summary in bag.topics):
            held = ", ".join(summary.topic.name for summary in bag.topics)
            raise _UsageError(f"--topics names {name}; {bag.path} has {held or 'no topics'}")
    return [
        summary
        for summary in bag.topics
        if summary.message_count
        and (arguments.topics is None or summary.topic.name in arguments.topics)
    ]


def _replay(
    bag: BagReader, topics: list[TopicSummary], arguments: argparse.Namespace, stop: StopRequest
) -> int:
    node = Replayer(topics, with_clock=arguments.clock is not None)
    if not node.topic_names:
        if topics:
            return _fail(f"no type of {bag.path} is installed here", 1)
        print(f"{bag.path} has no messages to replay")
        return 0
    node.get_logger().info(
        f"replaying {bag.path}: {len(node.topic_names)} topics, "
        f"{bag.duration / 1e9:.1f} s at {arguments.rate:g} times real time"
    )
    _await_subscribers(node, stop, patient=arguments.wait_for_subscribers)
    began = time.monotonic()
    count = 0
    while not stop.requested:
        count += _pass(bag, node, arguments, stop)
        if not arguments.loop or stop.wait(_LOOP_PAUSE):
            break
    if not stop.requested:
        for name in node.wait_for_acknowledgement(_ACKNOWLEDGEMENT):
            node.get_logger().warning(f"a subscriber of {name} has not confirmed all messages")
        # What is sent best effort is confirmed by nobody, and may still be on its way.
        stop.wait(_SETTLING)
    print(f"replayed {count} messages in {time.monotonic() - began:.1f} s", flush=True)
    return 0


def _await_subscribers(node: Replayer, stop: StopRequest, *, patient: bool) -> None:
    deadline = time.monotonic() + _DISCOVERY
    told = False
    while node.unheard:
        if time.monotonic() >= deadline:
            if not patient:
                break
            if not told:
                node.get_logger().info(f"waiting for subscribers of {', '.join(node.unheard)}")
                told = True
        if stop.wait(_LOOK_PERIOD):
            return
    stop.wait(_SETTLING)


def _pass(bag: BagReader, node: Replayer, arguments: argparse.Namespace, stop: StopRequest) -> int:
    """Replay the bag once; give the number of messages published."""
    offset = round(arguments.start * 1e9)
    start = bag.start_time + offset
    period = None if arguments.clock is None else arguments.rate * 1e9 / arguments.clock
    count = 0
    with ProgressLine(bag.path.name) as progress:
        events = with_ticks(bag.messages(node.topic_names, offset), start, period)
        event = next(events, None)  # read before the clock starts: the first read takes longest
        timeline = Timeline(start, time.monotonic(), arguments.rate)
        while event is not None:
            bag_time, message = event
            if timeline.sleep_until(bag_time, stop):
                break
            if message is None:
                node.publish_clock(bag_time)
            else:
                node.publish(message)
                count += 1
            if progress.is_due:
                at, end = (bag_time - bag.start_time) / 1e9, bag.duration / 1e9
                progress.show(f"{at:.1f} of {end:.1f} s, {count} messages")
            event = next(events, None)
    return count


def _fail(message: str, code: int) -> int:
    print(f"rpud replay: {message}", file=sys.stderr)
    return code
