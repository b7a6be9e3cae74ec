"""``rpud echo``: print the messages of a topic."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.drill_arguments import add_drill_arguments
from rpud_sim.cli.options import POSITIVE_SECONDS, Number
from rpud_sim.cli.program import CommandError, ExitCode, failing
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import complain

if TYPE_CHECKING:
    from rpud_sim.ros.client.topic_listener import TopicListener

HELP = "print the messages of a topic, of any installed type"
EXAMPLE = "rpud echo status --once"
DETAILS = (
    "Each message is a YAML document. The subscription asks for what the publishers offer, "
    "so a latched topic gives its last messages. Lost messages are counted on standard error."
)

_COUNT = Quantity("", "a number of messages", 1, 2**63 - 1, whole=True)
_WIDTH = 2**31 - 1  # of a line of YAML: no text is folded
_WAIT = 0.1  # between looks at the clock and at signals [s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "topic", metavar="TOPIC", help="name, relative to the namespace or absolute"
    )
    amount = parser.add_mutually_exclusive_group()
    amount.add_argument("--once", action="store_true", help="end after one message")
    amount.add_argument(
        "--count",
        action=Number,
        quantity=_COUNT,
        metavar="N",
        help="end after that many messages (default: at SIGINT or SIGTERM)",
    )
    parser.add_argument(
        "--duration",
        action=Number,
        quantity=POSITIVE_SECONDS,
        metavar="S",
        help="end after that many seconds",
    )
    parser.add_argument("--json", action="store_true", help="print one line of JSON per message")
    parser.add_argument(
        "--field", metavar="PATH", help="print only this field, such as header.stamp.sec"
    )
    parser.add_argument(
        "--full-length",
        action="store_true",
        help="print arrays and texts in full; otherwise YAML cuts them after 128 elements",
    )
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.ros.client import ClientError
    from rpud_sim.ros.client.listening_node import ListeningNode
    from rpud_sim.ros.client.topic_listener import CUT, FieldPath, TopicListener, to_plain
    from rpud_sim.ros.starting import StartError

    with (
        failing(ClientError),
        failing(StartError, code=ExitCode.USAGE),
        ListeningNode("rpud_echo", arguments.namespace, arguments.domain) as listening,
    ):
        listener = TopicListener(listening, arguments.topic, arguments.patience)
        field = FieldPath(arguments.field, listener.kind) if arguments.field else None
        cut = None if arguments.full_length or arguments.json else CUT
        text = _json if arguments.json else _yaml_text()

        def show(message: Any) -> None:
            value = message if field is None else field.value(message)
            sys.stdout.write(text(None if value is None else to_plain(value, cut)))

        return _echo(listener, show, arguments)


def _echo(
    listener: TopicListener, show: Callable[[Any], None], arguments: argparse.Namespace
) -> ExitCode:
    from rpud_sim.ros.stopping import StopRequest

    wanted = 1 if arguments.once else arguments.count
    end = None if arguments.duration is None else time.monotonic() + arguments.duration
    shown = lost = 0
    with StopRequest() as stop:
        while not stop.requested and (wanted is None or shown < wanted):
            rest = _WAIT if end is None else min(_WAIT, end - time.monotonic())
            if rest <= 0.0:
                if wanted is None:
                    break
                limit = f"within {arguments.duration:g} s"
                raise CommandError(f"{shown} of {wanted} messages on {listener.topic} {limit}")
            messages = listener.take(rest)
            for message in messages[: None if wanted is None else wanted - shown]:
                show(message)
                shown += 1
            if messages:
                sys.stdout.flush()
            if listener.lost > lost:
                lost = listener.lost
                complain("rpud echo", f"{lost} messages of {listener.topic} were lost")
    return ExitCode.DONE


def _json(plain: Any) -> str:
    from rpud_sim.ros.client.topic_listener import to_json_value

    return json.dumps(to_json_value(plain)) + "\n"


def _yaml_text() -> Callable[[Any], str]:
    import yaml

    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

    def write(plain: Any) -> str:
        text = yaml.dump(plain, Dumper=dumper, sort_keys=False, allow_unicode=True, width=_WIDTH)
        return text.removesuffix("...\n") + "---\n"

    return write
