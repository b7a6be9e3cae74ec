"""`rpud rebuild`: any waveform at any rate, exact, out of a bag's trajectory."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from rpud_sim.cli.progress import progress_bar
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.inspection.rebuild import Rebuilt

HELP = "make waveforms at any rate, exact, of the trajectory in a bag"
EXAMPLE = "rpud rebuild bags/first --rate 1000000 --out waveforms"

_GREATEST_RATE = 1e9  # Hz; time is whole nanoseconds
_LONGEST = 1e6  # s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud rebuild`."""
    parser.description = (
        f"{HELP[0].upper()}{HELP[1:]}: one NumPy file for each channel, and rebuilt.json. "
        "Sample n is at simulation time n / rate; where the trajectory lacks segments it is NaN."
    )
    parser.add_argument("bag", metavar="BAG", help="a bag's folder or one MCAP file")
    parser.add_argument(
        "--rate", type=float, required=True, metavar="HZ", help="of the samples, a whole number"
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="new folder for the files")
    parser.add_argument(
        "--start", type=float, default=0.0, metavar="S", help="leave out so much at the beginning"
    )
    parser.add_argument("--duration", type=float, metavar="S", help="rebuild at most so much")
    parser.add_argument(
        "--run",
        type=int,
        default=1,
        metavar="N",
        dest="number",
        help="which simulation, where resets began more (default: the first)",
    )
    parser.add_argument("--topic", metavar="NAME", help="the trajectory, where there are several")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Rebuild and print the account; give the exit code."""
    from rpud_sim.bag import BagError
    from rpud_sim.foundation.quantities import ParameterError
    from rpud_sim.inspection.rebuild import RebuildError, rebuild

    try:
        _check(arguments)
    except ParameterError as error:
        complain("rpud rebuild", error)
        return 2
    try:
        with progress_bar(" samples", scaled=True) as bar:
            rebuilt = rebuild(
                arguments.bag,
                arguments.out,
                int(arguments.rate),
                arguments.start,
                arguments.duration,
                arguments.number,
                arguments.topic,
                bar.update,
            )
    except (BagError, RebuildError) as error:
        complain("rpud rebuild", error)
        return 1
    print(json.dumps(vars(rebuilt), indent=2) if arguments.json else _account(rebuilt))
    return 0


def _check(arguments: argparse.Namespace) -> None:
    from rpud_sim.foundation.quantities import ParameterError, Quantity

    Quantity("Hz", "", 1.0, _GREATEST_RATE).check("--rate", arguments.rate)
    if arguments.rate % 1.0:
        raise ParameterError(f"--rate = {arguments.rate:g} Hz is not a whole number")
    Quantity("s", "", 0.0, _LONGEST).check("--start", arguments.start)
    if arguments.duration is not None:
        Quantity("s", "", 0.0, _LONGEST, exclusive=True).check("--duration", arguments.duration)


def _account(rebuilt: Rebuilt) -> str:
    from rpud_sim.simulation.sampling import CHANNELS

    lines = [
        f"rebuilt {rebuilt.count} samples of {len(CHANNELS)} channels at {rebuilt.rate} Hz "
        f"to {printable(rebuilt.path)}: {rebuilt.size / 1e6:.2f} MB",
        f"the bag's trajectory is {rebuilt.trajectory_size / 1e6:.2f} MB uncompressed",
    ]
    if rebuilt.runs > 1:
        lines.append(f"this is run {rebuilt.run} of {rebuilt.runs}, which resets began")
    if rebuilt.missing:
        lines.append(f"{rebuilt.missing} samples are NaN: segments are missing")
    return "\n".join(lines)
