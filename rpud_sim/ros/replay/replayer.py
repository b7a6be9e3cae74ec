"""Replay of a bag, until its end or until a signal stops it; the thread and services of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from rclpy.executors import SingleThreadedExecutor
from rpud_msgs.srv import Burst, GetRate, IsPaused, Seek, SetRate
from std_srvs.srv import Trigger

import rpud_sim.bag
from rpud_sim.bag import BagReader, TopicSummary
from rpud_sim.foundation.quantities import ExpectedError, ParameterError, suggestion
from rpud_sim.foundation.terminal import printable
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.replay.playback import Messages, Playback, PlaybackError, read_ahead
from rpud_sim.ros.replay.replay_options import DISCOVERY_TIME, ReplayOptions
from rpud_sim.ros.replay.replayer_node import Replayer
from rpud_sim.ros.starting import running_ros
from rpud_sim.ros.stopping import StopRequest
from rpud_sim.ros.threads import quick_switches, raised, serve, settled_memory

_PRIORITY = 10  # as of a drill: in real time or slower; faster, it could keep a core for itself
_SETTLING_TIME = 0.2  # s from a publisher's match to the subscriber's own
_POLL_PERIOD = 0.01  # s
_ACKNOWLEDGEMENT_TIME = 5.0  # s that reliable subscribers have after the last message
MakeBar = Callable[..., Any]
"""Maker of a progress bar: a ``tqdm`` with a ``title`` and a ``total`` in seconds."""


# Types of the services, and what they do; that returns fields of the response, none for a success.
_SERVICES: dict[str, tuple[Any, Callable[[Playback, Any], dict[str, Any] | None]]] = {
    "pause": (Trigger, lambda playback, request: playback.pause()),
    "resume": (Trigger, lambda playback, request: playback.pause(False)),
    "toggle_paused": (Trigger, lambda playback, request: playback.pause(not playback.paused)),
    "is_paused": (IsPaused, lambda playback, request: {"paused": playback.paused}),
    "get_rate": (GetRate, lambda playback, request: {"rate": playback.rate}),
    "set_rate": (SetRate, lambda playback, request: playback.set_rate(request.rate)),
    "seek": (
        Seek,
        lambda playback, request: playback.seek(
            join_seconds(request.time.sec, request.time.nanosec)
        ),
    ),
    "play_next": (Trigger, lambda playback, request: playback.play_next()),
    "burst": (
        Burst,
        lambda playback, request: {
            "actually_burst": playback.burst(request.num_messages),
            "success": True,
        },
    ),
    "stop": (Trigger, lambda playback, request: playback.stop()),
}


def offer_services(node: Replayer, playback: Playback) -> None:
    """Offer the services of ``ros2 bag play`` below the node's name, with their meanings.

    Their types are std_srvs/Trigger and those of rpud_msgs, with the reason of a refusal.
    """
    for name, (kind, act) in _SERVICES.items():
        node.create_service(kind, f"~/{name}", partial(_answer, node, playback, name, act))


def _answer(
    node: Replayer,
    playback: Playback,
    name: str,
    act: Callable[[Playback, Any], dict[str, Any] | None],
    request: Any,
    response: Any,
) -> Any:
    try:
        fields = playback.do(lambda each: act(each, request)) or {"success": True}
    except PlaybackError as error:
        node.get_logger().warning(f"{name} is refused: {error}")
        fields = {"success": False, "message": str(error)}
    except Exception as error:  # out of the executor it would leave a client without answer
        node.count_failure(f"{name}: {raised(error)}")
        fields = {"success": False, "message": raised(error)}
    for field, value in fields.items():
        if hasattr(response, field):  # those that only ask have no success
            setattr(response, field, value)
    return response


class OptionError(ParameterError):
    """Options that do not fit the bag; the message is one line."""


class ReplayError(ExpectedError, RuntimeError):
    """Bag of which no topic can be replayed; the message is one line."""


def replay(options: ReplayOptions, ros_arguments: Sequence[str], make_bar: MakeBar) -> str:
    """Replay to the end of the bag or until a signal stops it, and return a summary."""
    with StopRequest(options.with_parent) as stop, rpud_sim.bag.open(options.bag) as bag:
        topics = _chosen_topics(bag, options)
        with running_ros(ros_arguments):
            return _replay(bag, topics, options, stop, make_bar)


def _chosen_topics(bag: BagReader, options: ReplayOptions) -> list[TopicSummary]:
    duration = bag.duration / SECOND
    if options.start > duration:
        raise OptionError(
            f"--start is {options.start:g} s; it must be from 0 to {duration:.3f} s, "
            f"the duration of {bag.path}"
        )
    named = {
        "--topics": options.topics or (),
        "--exclude": options.exclude,
        "--remap": [rule.partition(":=")[0] for rule in options.remap],
    }
    held = [summary.topic.name for summary in bag.topics]
    for option, names in named.items():
        for name in names:
            if name not in held:
                has = ", ".join(held) or "no topics"
                hint = suggestion(name, held)
                raise OptionError(f"{option} names {name}{hint}; {bag.path} has {has}")
    return [
        summary
        for summary in bag.topics
        if summary.message_count
        and (options.topics is None or summary.topic.name in options.topics)
        and summary.topic.name not in options.exclude
    ]


def _replay(
    bag: BagReader,
    topics: list[TopicSummary],
    options: ReplayOptions,
    stop: StopRequest,
    make_bar: MakeBar,
) -> str:
    node = Replayer(topics, with_clock=options.clock is not None, remappings=options.remap)
    if not node.outlets:
        if topics:
            raise ReplayError(f"nothing of {bag.path} can be replayed here")
        return f"{printable(bag.path)} has no messages to replay"
    node.get_logger().info(
        f"replaying {printable(bag.path)}: {len(node.outlets)} topics, "
        f"{bag.duration / SECOND:.1f} s at {options.rate:g} times real time"
    )
    _await_subscribers(node, stop, patient=options.wait_for_subscribers)
    first = bag.start_time + round(options.start * SECOND)
    last = bag.end_time
    if options.duration is not None:
        last = min(last, first + round(options.duration * SECOND))

    def read(position: int) -> Messages:
        return read_ahead(bag.messages(list(node.outlets), position - bag.start_time))

    playback = Playback(read, (first, last), options, node, interrupted=lambda: stop.requested)
    offer_services(node, playback)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    bar = make_bar(title=printable(bag.path.name), total=(last - first) / SECOND)
    with quick_switches(), settled_memory(), bar, ThreadPoolExecutor(1) as pool:
        # Last of all: to make the rest takes Python's lock for longer than a message may wait.
        began = time.monotonic()
        playing = pool.submit(playback.run, _PRIORITY if options.rate <= 1.0 else 0)
        try:
            while not playing.done() and not stop.requested:
                serve(executor, node.count_failure)
                _show(playback, first, bar)
        finally:
            playback.stop()
        playing.result()
        if not stop.requested:
            for name in node.outlets.wait(_ACKNOWLEDGEMENT_TIME):
                node.get_logger().warning(f"a subscriber of {name} has not confirmed all messages")
            # Best-effort messages have no acknowledgement, and may still be on their way; whoever
            # asks now learns that the replay has ended.
            settled_at = time.monotonic() + _SETTLING_TIME
            while time.monotonic() < settled_at and not stop.requested:
                serve(executor, node.count_failure)
    executor.shutdown()
    failures = f", {node.failures} requests failed" if node.failures else ""
    return (
        f"replayed {playback.published} messages in {time.monotonic() - began:.1f} s, "
        f"{playback.lateness}{failures}"
    )


def _show(playback: Playback, first: int, bar: Any) -> None:
    """Show the position of the playback."""
    bar.n = min((playback.position - first) / SECOND, bar.total)
    state = "paused" if playback.paused else f"x{playback.rate:g}"
    bar.set_postfix_str(f"{state}, {playback.published} messages", refresh=False)
    bar.last_print_n = min(bar.last_print_n, bar.n)  # after a step backwards
    bar.update(0)


def _await_subscribers(node: Replayer, stop: StopRequest, *, patient: bool) -> None:
    deadline = time.monotonic() + DISCOVERY_TIME
    logged = False
    while unheard := node.outlets.unheard:
        if time.monotonic() >= deadline:
            if not patient:
                break
            if not logged:
                node.get_logger().info(f"waiting for subscribers of {', '.join(unheard)}")
                logged = True
        if stop.wait(_POLL_PERIOD):
            return
    stop.wait(_SETTLING_TIME)
