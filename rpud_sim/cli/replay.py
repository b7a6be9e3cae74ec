"""`rpud replay`: publish a bag's messages again."""

from __future__ import annotations

import argparse

from rpud_sim.ros.arguments import add_replay_arguments

HELP = "publish a bag's messages with their types, QoS and timing"
EXAMPLE = "rpud replay bags/first --rate 0.5"

add_arguments = add_replay_arguments


def run(arguments: argparse.Namespace) -> int:
    """Replay until the end of the bag or until a signal asks to stop; give the exit code."""
    from rpud_sim.ros.replay import replayer

    return replayer.run(arguments)
