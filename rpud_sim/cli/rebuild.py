"""``rpud rebuild``: exact waveforms at any rate from a bag's trajectory."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rpud_sim.cli.options import (
    Number,
    add_bag_argument,
    add_json_argument,
    add_range_arguments,
)
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import printable

if TYPE_CHECKING:
    from rpud_sim.inspection.rebuild import Rebuilt

HELP = "make exact waveforms at any rate from the trajectory in a bag"
DETAILS = (
    "It writes one NumPy file for each channel, and rebuilt.json. Sample n is at simulation time "
    "n / rate; where the trajectory lacks segments it is NaN."
)
EXAMPLE = "rpud rebuild bags/first --rate 1000000 --out waveforms"

_RATE = Quantity("Hz", "of the samples", 1.0, 1e9, whole=True)  # time is whole nanoseconds
_LONGEST = 1e6  # s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag_argument(parser)
    parser.add_argument(
        "--rate",
        action=Number,
        quantity=_RATE,
        required=True,
        metavar="HZ",
        help="of the samples, a whole number",
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="new folder for the files")
    add_range_arguments(parser, "rebuild", _LONGEST)
    parser.add_argument(
        "--run",
        type=int,
        default=1,
        metavar="N",
        dest="number",
        help="number of the simulation, if resets began several (default: the first)",
    )
    parser.add_argument(
        "--topic", metavar="NAME", help="topic of the trajectory, if there are several"
    )
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.bag import BagError
    from rpud_sim.inspection.rebuild import RebuildError, rebuild

    with failing(BagError, RebuildError), progress_bar(" samples", scaled=True) as bar:
        rebuilt = rebuild(
            arguments.bag,
            arguments.out,
            arguments.rate,
            arguments.start,
            arguments.duration,
            arguments.number,
            arguments.topic,
            bar.update,
        )
    print_json(vars(rebuilt)) if arguments.json else print(_account(rebuilt))
    return ExitCode.DONE


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
