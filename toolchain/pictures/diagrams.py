"""Drawings of the pages: their numbers are the code's, and their motion is a run's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import preset
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.topics import COMMAND_TOPICS, TOPICS

# Part of a run in rock that shows all: the free mass commutes, while the drill springs back.
BEGIN, END = 547_920_000, 548_600_000  # [ns]
_STEP = 500  # between two samples of the path [ns]
_SCALE_TIME, _SCALE_LENGTH = 5e-5, 1e-4  # of the bars beside it [s, m]

_LEFT, _RIGHT, _TOP, _FLOOR, _FOOT = 40.0, 748.0, 60.0, 232.0, 262.0  # [px]


def draw_drill() -> str:
    """Return the section of the drill, with its parts named."""
    parameters = preset("drilling")
    return render(
        "drill.svg.jinja",
        frequency=f"{parameters.vibration_frequency / 1e3:g}",
        amplitude=f"{parameters.vibration_amplitude * 1e6:g}",
        free_mass=f"{parameters.free_mass * 1e3:g}",
    )


def draw_interface() -> str:
    """Return the nodes around a drill, and its main topics."""
    published = ("reacting_force", "contact_force", "drill_tool", "status")
    assert set(published) <= set(TOPICS)
    return render("interface.svg.jinja", commands=list(COMMAND_TOPICS), published=published)


def draw_blocks() -> str:
    """Return the time line of four blocks at the node's default rate."""
    period = 1e3 / Settings().telemetry_rate
    return render("blocks.svg.jinja", period=round(period))


def draw_events() -> str:
    """Return the paths of the bodies during a part of a run, with its events."""
    run = Simulation(preset("drilling")).advance_to(END)
    count = (END - BEGIN) // _STEP
    samples = run.sample(Times.from_grid(BEGIN // _STEP, count, SECOND // _STEP))
    paths = {
        "tip": samples.actuator_position,
        "tool": samples.drill_tool_displacement,
        "mass": samples.free_mass_position,
    }
    highest, lowest = min(map(np.min, paths.values())), max(map(np.max, paths.values()))
    per_meter = (_FLOOR - _TOP) / (lowest - highest)
    per_second = (_RIGHT - _LEFT) / (END - BEGIN) * SECOND

    def across(time: np.ndarray) -> np.ndarray:
        return _LEFT + (time - BEGIN / SECOND) * per_second

    times = across((BEGIN + _STEP * np.arange(count)) / SECOND)
    heights = {name: _TOP + (path - highest) * per_meter for name, path in paths.items()}
    segments = run.segments
    starts = across(segments["start_seconds"] + segments["start_fraction"])
    ends = starts + segments["duration"] * per_second
    shown = (starts >= _LEFT) & (ends <= _RIGHT)
    flights = shown & (segments["contact"] == 0)
    middle = np.flatnonzero(flights)[np.argmax((ends - starts)[flights])]
    at = int(np.searchsorted(times, starts[middle] + 0.6 * (ends - starts)[middle]))
    return render(
        "events.svg.jinja",
        width=800,
        height=330,
        left=_LEFT,
        right=_RIGHT,
        floor=_FLOOR,
        foot=_FOOT,
        duration=f"{(END - BEGIN) / SECOND * 1e3:g}",
        contact=f"{np.median(segments['duration'][shown & (segments['contact'] != 0)]) * 1e6:.0f}",
        events=[round(float(start), 1) for start in starts[(starts >= _LEFT) & (starts < _RIGHT)]],
        segments=[
            round(float(starts[each] + ends[each]) / 2, 1)
            for each in np.flatnonzero(flights)
            if ends[each] - starts[each] > 70.0  # else there is no room for the word
        ],
        named=(round(float(times[at]), 1), round(float(heights["mass"][at]) - 14, 1)),
        scale={
            "time": round(_SCALE_TIME * per_second, 1),
            "time_name": f"{_SCALE_TIME * 1e3:g} ms",
            "length": round(_SCALE_LENGTH * per_meter, 1),
            "length_name": f"{_SCALE_LENGTH * 1e3:g} mm",
        },
        **{name: _path(times, height) for name, height in heights.items()},
    )


def _path(times: np.ndarray, heights: np.ndarray) -> str:
    """Return the coordinates of a line; points on a straight line between others are left out."""
    kept = np.ones(len(times), dtype=bool)
    kept[1:-1] = np.abs(np.diff(heights, 2)) > 1e-3
    points = np.column_stack([times, heights])[kept]
    return "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def render(name: str, **context: Any) -> str:
    """Return a drawing from its template beside this file."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(name).render(**context)
