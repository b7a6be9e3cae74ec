"""The replayer: `rpud replay`, and the executable `replayer` of `ros2 run`."""

from __future__ import annotations

import argparse
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import remove_ros_args

import rpud_sim.bag
from rpud_sim.bag import BagError, BagReader, TopicSummary
from rpud_sim.foundation.terminal import complain, printable
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.arguments import DISCOVERY_TIME, add_replay_arguments
from rpud_sim.ros.replay.playback import Plan, Playback
from rpud_sim.ros.replay.playback_thread import PlaybackThread
from rpud_sim.ros.replay.read_ahead import ReadAhead
from rpud_sim.ros.replay.replay_console import ReplayConsole
from rpud_sim.ros.replay.replay_services import ReplayServices
from rpud_sim.ros.replay.replayer_node import Replayer
from rpud_sim.ros.serving import serve
from rpud_sim.ros.starting import StartError, start_ros
from rpud_sim.ros.stopping import StopRequest

_SETTLING = 0.2  # s from a publisher's match to the subscriber's own
_LOOK_PERIOD = 0.01  # s
_ACKNOWLEDGEMENT = 5.0  # s that reliable subscribers have after the last message
_SWITCH_INTERVAL = 1e-4  # s after which Python's other threads let the one that plays go on


class _UsageError(Exception):
    """Arguments do not fit the bag."""


def run(arguments: argparse.Namespace, ros_arguments: list[str] | None = None) -> int:
    """Replay until the end of the bag or until a signal asks to stop; give the exit code."""
    with StopRequest() as stop:
        try:
            with rpud_sim.bag.open(arguments.bag) as bag:
                topics = _chosen(bag, arguments)
                start_ros(ros_arguments or [])
                try:
                    return _replay(bag, topics, arguments, stop)
                finally:
                    rclpy.try_shutdown()
        except BagError as error:
            return _fail(str(error), 1)
        except (_UsageError, ParameterException, StartError) as error:
            return _fail(str(error), 2)


def main() -> None:
    """Run the executable; ROS arguments follow `--ros-args`."""
    parser = argparse.ArgumentParser(prog="replayer", description=__doc__)
    add_replay_arguments(parser)
    words, ros_arguments = _without_ros_arguments(sys.argv[1:])
    try:
        remove_ros_args(ros_arguments)
    except RuntimeError as error:
        parser.error(str(error))
    sys.exit(run(parser.parse_args(words), ros_arguments))


def _without_ros_arguments(words: list[str]) -> tuple[list[str], list[str]]:
    """Split words into our own and those from `--ros-args` to `--`.

    rclpy would take the rules of our own --remap for ROS arguments as well.
    """
    own, ros = list(words), []
    while "--ros-args" in own:
        begin = own.index("--ros-args")
        end = own.index("--", begin) + 1 if "--" in own[begin:] else len(own)
        ros += own[begin:end]
        del own[begin:end]
    return own, ros


def _chosen(bag: BagReader, arguments: argparse.Namespace) -> list[TopicSummary]:
    """Check the arguments against the bag, and give the topics that have something to replay."""
    duration = bag.duration / SECOND
    if arguments.start > duration:
        raise _UsageError(
            f"--start is {arguments.start:g} s; it must be from 0 to {duration:.3f} s, "
            f"the duration of {bag.path}"
        )
    named = {
        "--topics": arguments.topics or (),
        "--exclude": arguments.exclude,
        "--remap": [rule.partition(":=")[0] for rule in arguments.remap],
    }
    held = [summary.topic.name for summary in bag.topics]
    for option, names in named.items():
        for name in names:
            if name not in held:
                has = ", ".join(held) or "no topics"
                raise _UsageError(f"{option} names {name}; {bag.path} has {has}")
    return [
        summary
        for summary in bag.topics
        if summary.message_count
        and (arguments.topics is None or summary.topic.name in arguments.topics)
        and summary.topic.name not in arguments.exclude
    ]


def _plan(bag: BagReader, arguments: argparse.Namespace) -> Plan:
    first = bag.start_time + round(arguments.start * SECOND)
    last = bag.end_time
    if arguments.duration is not None:
        last = min(last, first + round(arguments.duration * SECOND))
    return Plan(
        first=first,
        last=last,
        rate=arguments.rate,
        paused=arguments.start_paused,
        loop=arguments.loop,
        tick=None if arguments.clock is None else SECOND / arguments.clock,
    )


def _replay(
    bag: BagReader, topics: list[TopicSummary], arguments: argparse.Namespace, stop: StopRequest
) -> int:
    node = Replayer(topics, with_clock=arguments.clock is not None, remappings=arguments.remap)
    if not node.topic_names:
        if topics:
            return _fail(f"nothing of {bag.path} can be replayed here", 1)
        print(f"{printable(bag.path)} has no messages to replay")
        return 0
    node.get_logger().info(
        f"replaying {printable(bag.path)}: {len(node.topic_names)} topics, "
        f"{bag.duration / 1e9:.1f} s at {arguments.rate:g} times real time"
    )
    _await_subscribers(node, stop, patient=arguments.wait_for_subscribers)
    began = time.monotonic()
    plan = _plan(bag, arguments)

    def read(position: int) -> ReadAhead:
        return ReadAhead(bag.messages(node.topic_names, position - bag.start_time))

    playback = Playback(read, plan, node)
    thread = PlaybackThread(playback)
    ReplayServices(node, thread, node.count_failure)
    with (
        _quick_switches(),
        _spinning(node),
        ReplayConsole(
            thread,
            plan,
            printable(bag.path.name),
            node.get_logger(),
            keys=not arguments.disable_keyboard_controls,
        ) as console,
    ):
        while thread.running and not stop.requested:
            console.look(playback)
        thread.stop()
        thread.join()
        if not stop.requested:
            for name in node.wait_for_acknowledgement(_ACKNOWLEDGEMENT):
                node.get_logger().warning(f"a subscriber of {name} has not confirmed all messages")
            # What is sent best effort is confirmed by nobody, and may still be on its way.
            stop.wait(_SETTLING)
    failures = f", {node.failures} requests failed" if node.failures else ""
    print(
        f"replayed {playback.published} messages in {time.monotonic() - began:.1f} s, "
        f"{playback.lateness}{failures}",
        flush=True,
    )
    return 0


def _await_subscribers(node: Replayer, stop: StopRequest, *, patient: bool) -> None:
    deadline = time.monotonic() + DISCOVERY_TIME
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


@contextmanager
def _spinning(node: Replayer) -> Iterator[None]:
    """Answer the node's services meanwhile, in a thread."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            serve(executor, node.count_failure)

    thread = threading.Thread(target=spin, name="services", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        executor.wake()
        thread.join()
        executor.shutdown()


@contextmanager
def _quick_switches() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_INTERVAL)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def _fail(message: str, code: int) -> int:
    complain("rpud replay", message)
    return code
