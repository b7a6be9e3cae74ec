"""Plots of a bag: which signals are drawn together."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rpud_sim.watch.recorded.recording import Recording
from rpud_sim.watch.recorded.signals import IMPACTS, Signal

CHOSEN = 2  # plots whose signal the reader chooses
_MOST_OTHERS = 6  # plots of a bag without a drill
_OURS = "rpud_msgs/"
_STATUS = "rpud_msgs/msg/Status"
_MOUNT = "rpud_msgs/msg/Mount"
_ROTATION = "rpud_msgs/msg/Rotation"


@dataclass(frozen=True)
class Layer:
    """Line of a plot, or the points of impacts."""

    name: str  # in the legend; no other layer of the plot has it
    signal: Signal | None = None  # of a topic; None for a channel of the rebuilt waveform
    channel: str = ""  # of the waveform that is rebuilt from the trajectory; empty for a signal
    # whether it has the single messages of impacts, and is empty in the overview
    points: bool = False
    spread: bool = False  # whether it has the spread of these, and is empty elsewhere
    # channel of the waveform that the signal samples; the signal is left out where that is
    # drawn, since a line between its samples would contradict it
    sampled: str = ""


@dataclass(frozen=True)
class Content:
    """Content of one plot."""

    title: str  # of the plot
    unit: str  # of its values
    layers: tuple[Layer, ...]  # from back to front
    chosen: bool = False  # whether the reader chooses its signal


# Title, unit, signals (name, type, column, sampled channel), channels (name, channel).
_PLOTS: tuple[
    tuple[str, str, tuple[tuple[str, str, str, str], ...], tuple[tuple[str, str], ...]], ...
] = (
    (
        "contact force",
        "N",
        (("peak of an impact", IMPACTS, "peak_force", ""),),
        (("rebuilt force", "contact_force"),),
    ),
    (
        "position along the drill axis",
        "m",
        (("nodal plane", "rpud_msgs/msg/NodalPlane", "position", "nodal_plane_position"),),
        (
            ("rebuilt nodal plane", "nodal_plane_position"),
            ("rebuilt actuator tip", "actuator_position"),
            ("rebuilt free mass", "free_mass_position"),
        ),
    ),
    (
        "displacement of the drill tool",
        "m",
        (("drill tool", "rpud_msgs/msg/DrillTool", "displacement", "drill_tool_displacement"),),
        (("rebuilt drill tool", "drill_tool_displacement"),),
    ),
    (
        "reacting force",
        "N",
        (
            ("reacting force", "rpud_msgs/msg/ReactingForce", "force", "reacting_force"),
            ("weight on bit", _STATUS, "weight_on_bit", ""),
        ),
        (("rebuilt reacting force", "reacting_force"),),
    ),
    (
        "power",
        "W",
        (
            ("work of the vibration", _STATUS, "actuator_power", ""),
            ("taken by tool and rock", _STATUS, "absorbed_power", ""),
            ("electrical", _STATUS, "electrical_power", ""),
        ),
        (),
    ),
    (
        "force of the arm",
        "N",
        (("arm", _MOUNT, "force", ""), ("weight on bit", _MOUNT, "weight_on_bit", "")),
        (),
    ),
    (
        "feed, mount and depth of the hole",
        "m",
        (
            ("feed", _MOUNT, "feed", ""),
            ("mount", _MOUNT, "position", ""),
            ("depth", "rpud_msgs/msg/Borehole", "depth", ""),
        ),
        (),
    ),
    ("rotation", "rad/s", (("rate", _ROTATION, "rate", ""),), ()),
    (
        "torque",
        "N m",
        (
            ("rock and cuttings", _ROTATION, "torque", ""),
            ("drive", _ROTATION, "drive_torque", ""),
        ),
        (),
    ),
)


def drills(recording: Recording) -> list[str]:
    """Return the namespaces of drills; of a bag without a drill, those with signals."""
    found = {signal.drill for signal in recording.signals}
    first = {signal.drill for signal in recording.signals if signal.type.startswith(_OURS)}
    first |= {drill for drill in found if recording.trajectory(drill)}
    return sorted(first or found)


def contents(
    recording: Recording, drill: str, has: Callable[[Signal], bool] = lambda signal: True
) -> tuple[Content, ...]:
    """Return the plots of a drill, or of any other namespace, with those to choose last.

    ``has`` says whether anything of a signal can be drawn; others are not chosen at first.
    """
    signals = [signal for signal in recording.signals if signal.drill == drill]
    found = [*_drill_plots(recording, drill, signals)]
    if not found:
        found = [_single(signal) for signal in signals[:_MOST_OTHERS]]
    left = [signal for signal in recording.signals if not _shown(signal, found)]
    left.sort(key=lambda signal: (not has(signal), signal.drill != drill))
    chosen = [_single(signal, number) for number, signal in enumerate(left[:CHOSEN], 1)]
    return (*found, *chosen)


def _single(signal: Signal, number: int = 0) -> Content:
    title = f"chosen signal {number}" if number else signal.name
    return Content(title, "", (Layer("value", signal),), chosen=bool(number))


def _shown(signal: Signal, found: list[Content]) -> bool:
    return any(layer.signal == signal for content in found for layer in content.layers)


def _drill_plots(recording: Recording, drill: str, signals: list[Signal]) -> Iterator[Content]:
    by_kind = {(signal.type, signal.column): signal for signal in reversed(signals)}
    rebuilt = recording.trajectory(drill) is not None
    for title, unit, wanted, channels in _PLOTS:
        layers = [
            Layer(name, by_kind[kind, column], points=kind == IMPACTS, sampled=channel)
            for name, kind, column, channel in wanted
            if (kind, column) in by_kind
        ]
        layers += [
            Layer("least and greatest peak", layer.signal, spread=True)
            for layer in layers
            if layer.points
        ]
        layers += [Layer(name, channel=channel) for name, channel in channels if rebuilt]
        if layers:
            yield Content(title, unit, tuple(layers))
