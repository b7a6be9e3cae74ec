"""Picture of a recorded run: ``python -m toolchain.pictures.first_light BAG OUT.png``.

From top to bottom: the peak force of every impact on the drill tool, the three bodies during a few
milliseconds, and the reacting force with its mean.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import rpud_sim.bag
from rpud_sim.bag import BagError, BagReader
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.terminal import complain
from rpud_sim.foundation.time import SECOND

ZOOM = 0.010  # length of the middle panel [s]

# Okabe and Ito's colours: distinct with every kind of colour vision.
ACTUATOR, FREE_MASS, DRILL_TOOL, FORCE, MEAN = "#0072B2", "#E69F00", "#000000", "#56B4E9", "#D55E00"


@dataclasses.dataclass(frozen=True)
class Run:
    """Part of a run that a picture shows; times in s from the beginning of the picture, SI units.

    Args:
        impact_times: shape (n,).
        peak_forces: of the impacts, shape (n,).
        times: of the waveform's samples, shape (m,).
        waveform: channels by field name, each of shape (m,).
    """

    impact_times: np.ndarray
    peak_forces: np.ndarray
    times: np.ndarray
    waveform: dict[str, np.ndarray]


def read_run(bag: BagReader, start: float, duration: float) -> Run:
    """Return a part of a bag.

    Args:
        bag: with one ``contact_force`` and one ``waveform``.
        start: of the part, from the beginning of the waveform [s].
        duration: of the part [s].

    Raises:
        BagError: if the bag does not hold that part.
    """
    blocks = _messages(bag, "rpud_msgs/msg/Waveform")
    origin = _stamp(blocks[0]) + round(start * SECOND)
    period = blocks[0].sample_period
    sequence = blocks[0].sequence
    numbers = np.concatenate(
        [b.sequence - sequence + np.arange(len(b.contact_force)) for b in blocks]
    )
    times = numbers * period - start
    shown = (times >= 0.0) & (times < duration)
    if np.count_nonzero(shown) * period < 0.99 * duration:
        raise BagError(f"{bag.path} holds no waveform from {start:g} s to {start + duration:g} s")
    channels = (
        "actuator_position",
        "free_mass_position",
        "drill_tool_displacement",
        "reacting_force",
    )
    waveform = {
        name: np.concatenate([getattr(block, name) for block in blocks])[shown] for name in channels
    }
    impacts = _messages(bag, "rpud_msgs/msg/ContactForce")
    impact_times = np.array([_stamp(impact) - origin for impact in impacts]) / SECOND
    peaks = np.array([impact.peak_force for impact in impacts])
    within = (impact_times >= 0.0) & (impact_times < duration)
    return Run(impact_times[within], peaks[within], times[shown], waveform)


def draw(run: Run) -> Figure:
    """Return the figure with three panels."""
    figure = Figure(figsize=(9.0, 7.5), dpi=110, layout="constrained")
    top, middle, bottom = figure.subplots(3, 1)
    _draw_impacts(top, run)
    _draw_positions(middle, run)
    _draw_reacting_force(bottom, run)
    for axes in (top, middle, bottom):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(x=0.0)
    end = 2.0 * run.times[-1] - run.times[-2]  # of the last sample's period
    for axes in (top, bottom):
        axes.set_xlim(0.0, end)
    return figure


def _draw_impacts(axes: Axes, run: Run) -> None:
    axes.vlines(run.impact_times, 0.0, run.peak_forces / 1e3, color=ACTUATOR, linewidth=0.8)
    axes.set_ylim(bottom=0.0)
    rate = len(run.impact_times) / float(run.times[-1] - run.times[0])
    axes.set_title(f"Impacts on the drill tool, {rate:.0f} per second", loc="left")
    axes.set_ylabel("peak contact force [kN]")
    axes.set_xlabel("time [s]")


def _draw_positions(axes: Axes, run: Run) -> None:
    start = run.times[len(run.times) // 2]
    shown = (run.times >= start) & (run.times < start + ZOOM)
    time = 1e3 * (run.times[shown] - start)
    for name, text, color, width in (
        ("actuator_position", "actuator tip", ACTUATOR, 0.9),
        ("free_mass_position", "free mass", FREE_MASS, 1.8),
        ("drill_tool_displacement", "drill tool", DRILL_TOOL, 1.5),
    ):
        axes.plot(time, 1e3 * run.waveform[name][shown], color=color, linewidth=width, label=text)
    axes.invert_yaxis()  # the rock is below
    _legend(axes)
    axes.set_title("The free mass between actuator and drill tool", loc="left")
    axes.set_ylabel("position [mm], rock below")
    axes.set_xlabel(f"time after {start:.2f} s [ms]")


def _draw_reacting_force(axes: Axes, run: Run) -> None:
    force = run.waveform["reacting_force"]
    mean = float(force.mean())
    axes.plot(run.times, force, color=FORCE, linewidth=0.8)
    axes.axhline(mean, color=MEAN, linewidth=1.8, label=f"mean {mean:.1f} N")
    axes.set_ylim(bottom=min(0.0, float(force.min())))
    _legend(axes)
    axes.set_title("Reacting force on the mount", loc="left")
    axes.set_ylabel("force [N]")
    axes.set_xlabel("time [s]")


def _legend(axes: Axes) -> None:
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, borderpad=0.2)


def _messages(bag: BagReader, type_name: str) -> list[Any]:
    """Return the decoded messages of the only topic of a type."""
    found = [topic for topic in bag.topics if topic.topic.type == type_name and topic.message_count]
    if len(found) != 1:
        raise BagError(f"{bag.path} holds {len(found)} topics of {type_name}; it must be one")
    codec = Codec(type_name, found[0].definition or "")
    return [codec.decode(message.data) for message in bag.messages([found[0].topic.name])]


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def main() -> int:
    """Draw the picture; return the exit code."""
    parser = argparse.ArgumentParser(prog="picture", description="Draw a recorded run.")
    parser.add_argument("bag", metavar="BAG", help="a bag of the drill")
    parser.add_argument("out", metavar="OUT", type=Path, help="the picture's file")
    parser.add_argument(
        "--start", type=float, default=1.0, metavar="S", help="default: %(default)s"
    )
    parser.add_argument(
        "--duration", type=float, default=1.0, metavar="S", help="default: %(default)s"
    )
    arguments = parser.parse_args()
    try:
        with rpud_sim.bag.open(arguments.bag) as bag:
            run = read_run(bag, arguments.start, arguments.duration)
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        draw(run).savefig(arguments.out)
    except (BagError, OSError) as error:
        complain("picture", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
