"""Page of a drill in a terminal: lines of text with styles, made from a picture of the drill."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections.abc import Sequence
from typing import Any

from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.client.drill_finder import FoundDrill
from rpud_sim.watch.picture import CONNECTED, DONE, WAITING, FaultView, Outcome, Picture, Series
from rpud_sim.watch.terminal_course import (
    BLOCKS,
    columns_of,
    figure,
    greatest,
    rate,
    recent,
    sparkline,
)

HEIGHT, WIDTH = 22, 80
"""Size in which everything has a place: a serial console of 24 lines has two below the page."""

ALARM, HEADING, STRONG, PLAIN = "bold red", "reverse", "bold", ""
"""Styles, as Rich names them: they suit a light and a dark terminal, and one without colours."""

_LABEL, _VALUE = 16, 10  # columns before a sparkline
_FIXED_LINES = 17  # of the page without those of faults and outcomes

Line = tuple[tuple[str, str], ...]
"""Texts of a line, each with its style."""


@dataclasses.dataclass(frozen=True)
class Face:
    """What a page looks like."""

    width: int = WIDTH  # of the terminal [columns]
    height: int = HEIGHT  # of the page [lines]
    steps: str = BLOCKS  # of sparklines, from the lowest to the highest


def line(text: str = "", style: str = PLAIN) -> Line:
    """Return a line of one style, in which nothing steers the terminal."""
    return ((printable(text), style),)


def plain(content: Line) -> str:
    """Return the text of a line."""
    return "".join(text for text, _ in content)


def page_of(picture: Picture, face: Face, drills: int = 1) -> list[Line]:
    """Return the lines of a picture.

    Args:
        drills: number of drills that can be shown.
    """
    lines = [_header(picture, face, drills), _banner(picture)]
    if not picture.status:
        return lines
    arm = _arm(picture)
    room = face.height - _FIXED_LINES - len(arm)
    said = [_outcome_lines(outcome, face) for outcome in picture.outcomes]
    most = room - (2 if picture.faults else 0)  # a long reason is worth more than old faults
    outcomes = max(2, min(len(said[-1]), most)) if said else 2
    faults = max(0, min(max(3, len(picture.faults)), room - outcomes))
    outcomes = max(1, room - faults)
    lines += [
        *_commands(picture.status),
        *_condition(picture.status),
        *arm,
        line(f" {'last minute':{_LABEL + _VALUE}} ", STRONG),
        *_sparklines(picture.series, face),
        line(" powers over the last second", STRONG),
        *_powers(picture.status),
        *_faults(picture, faults),
        *_timing(picture, face),
        *_last_lines(said, outcomes),
    ]
    return lines


def outcome_text(outcome: Outcome) -> str:
    """Return what an action asked for and what became of it, in one line."""
    given = " ".join(
        f"{value}" if name in _UNNAMED else f"{name}={value}"
        for name, value in outcome.arguments.items()
        if value is not None
    )
    asked = f"{outcome.name} {given}".rstrip()
    said = f": {outcome.text}" if outcome.text else ""
    return f"{asked}: {outcome.state}{said}"


_POWERS = (
    *("actuator", "weight", "change", "electrical"),
    *("absorbed", "collision", "load_damper", "stored"),
)
_UNNAMED = ("force", "kind", "which", "seconds", "scope")


def _header(picture: Picture, face: Face, drills: int) -> Line:
    status = picture.status
    words = [picture.namespace]
    if status:
        words += [status["state"], status["regime"]]
    if picture.time is not None:
        words.append(f"{picture.time:.1f} s")
    if status:
        words.append(f"x{status['real_time_factor']:.2f}")
    left = printable(" " + "   ".join(words))
    right = f"{drills} drills, l lists them " if drills > 1 else "rpud watch "
    return ((f"{left:{max(0, face.width - len(right))}}{right}"[: face.width], HEADING),)


def _banner(picture: Picture) -> Line:
    connection = picture.connection
    if connection.state == CONNECTED:
        status = picture.status
        if status and status["commands_lost"]:
            return line(" Commands stopped arriving: the drill has made itself safe.", ALARM)
        if any(fault.kind == "free_mass_jammed" for fault in _active(picture)):
            return line(" The free mass is jammed: it strikes no more.", ALARM)
        return line()
    return line(f" {connection.state}: {connection.reason}", f"{ALARM} reverse")


def _commands(status: Any) -> list[Line]:
    on = status["drive_enabled"]
    drive = f"{status['drive_voltage']:.4g} V {status['drive_frequency']:.6g} Hz" if on else "off"
    weight = f"{status['weight_on_bit']:.4g} N"
    commanders = status["commanders"]
    others = f"  {commanders} publishers command at once" if commanders > 1 else ""
    return [
        (
            (f" {'weight on bit':{_LABEL}}", PLAIN),
            (f"{weight:22}", STRONG),
            (f"since {status['weight_on_bit_applied']:.3f} s", PLAIN),
            (others, ALARM),
        ),
        (
            (f" {'drive':{_LABEL}}", PLAIN),
            (f"{drive:22}", STRONG),
            (f"since {status['drive_applied']:.3f} s", PLAIN),
        ),
    ]


def _condition(status: Any) -> list[Line]:
    texts = [
        f"vibration {1e6 * status['vibration_amplitude']:.2f} um",
        f"resonance {status['resonance_frequency']:.1f} Hz",
        f"{status['actuator_temperature']:.1f} K",
    ]
    if math.isfinite(status["depth"]):
        depth = f"depth {1e3 * status['depth']:.2f} mm"
        texts.insert(0, f"{depth}, {1e3 * status['penetration_rate']:.3f} mm/s")
    return [line(f" {'   '.join(texts)}")]


def _arm(picture: Picture) -> list[Line]:
    """Return a line for each model around the percussion that is on: feed, rotation and hole."""
    lines = []
    if mount := picture.latest.get("mount"):
        touches = "in contact" if mount["in_contact"] else "no contact"
        text = f"arm {mount['force']:.2f} N   {touches}"
        if mount["slip"]:
            text += f"   slip {1e3 * mount['slip']:.2f} mm"
        value = f"{_feed_text(picture.status)} at {1e3 * mount['feed']:.2f} mm"
        lines.append(_row("feed", value, text))
    if rotation := picture.latest.get("rotation"):
        said = "stalled" if rotation["stalled"] else ""
        text = f"torque {1e3 * rotation['torque']:.2f} mN m"
        text += f"   drive {1e3 * rotation['drive_torque']:.2f} mN m"
        style = ALARM if rotation["stalled"] else PLAIN
        turn = _row("rotation", f"{rotation['rate']:.2f} rad/s", text)
        lines.append((*turn, (f"   {said}", style)) if said else turn)
    if hole := picture.latest.get("borehole"):
        layer = printable(str(hole["layer"])) or "broken through"
        text = f"cuttings {1e9 * hole['packed_cuttings']:.0f} mm3   wear {hole['bit_wear']:.2f}"
        if hole["side_offset"]:
            text += f"   walked {1e3 * hole['side_offset']:.2f} mm"
        lines.append(_row("rock", layer, text))
    return lines


def _row(label: str, value: str, text: str) -> Line:
    return ((f" {label:{_LABEL}}", PLAIN), (f"{value:21} ", STRONG), (text, PLAIN))


def _feed_text(status: Any) -> str:
    """Return what the feed is to do."""
    value = 1e3 * status.get("feed_value", math.nan)
    if status.get("feed_mode") == 1:
        return f"to {value:.4g} mm"
    return f"{value:.4g} mm/s" if value else "holds"


def _sparklines(series: Series, face: Face) -> list[Line]:
    width = max(1, face.width - _LABEL - _VALUE - 3)

    def row(label: str, unit: str, name: str, total: bool) -> Line:
        values = recent(series, name)
        value = rate(values, series.period) if total else greatest(values)
        nothing = "none" if len(values) else "no data"
        shown = f"{figure(value)} {unit}" if math.isfinite(value) else nothing
        drawn = sparkline(columns_of(series, name, width, total), face.steps)
        return (
            (f" {label:{_LABEL}}", PLAIN),
            (f"{shown:>{_VALUE}}", STRONG),
            (f"  {drawn}", PLAIN),
        )

    return [
        row("impacts", "/s", "impacts", True),
        row("peak force", "N", "peak_force_max", False),
        row("reacting force", "N", "reacting_force_max", False),
        row("energy to rock", "W", "energy_transferred", True),
    ]


def _powers(status: Any) -> list[Line]:
    watts = {name: _watts(status[f"{name}_power"]) for name in _POWERS}
    given = f"actuator {watts['actuator']}   weight {watts['weight']}"
    if math.isfinite(status["change_power"]) and abs(status["change_power"]) >= 0.005:
        given += f"   changes {watts['change']}"
    if math.isfinite(feed := status.get("feed_power", math.nan)):
        given += f"   feed {1e3 * feed:.2f} mW"
    if math.isfinite(status["electrical_power"]):
        given += f"   electrical {watts['electrical']}"
    taken = (
        f"tool and rock {watts['absorbed']}   collisions {watts['collision']}   "
        f"damper {watts['load_damper']}   stored {watts['stored']}"
    )
    return [line(f" in   {given}"), line(f" out  {taken}")]


def _active(picture: Picture) -> list[FaultView]:
    return [fault for fault in picture.faults if fault.active]


def _faults(picture: Picture, room: int) -> list[Line]:
    active = len(_active(picture))
    over = len(picture.faults) - active
    heading = f" faults: {active} now, {over} over" if picture.faults else " no faults"
    lines = [line(heading, ALARM if active else STRONG)]
    # Those that last come first: they matter now.
    order = sorted(picture.faults, key=lambda fault: (not fault.active, -fault.number))
    for fault in order[:room]:
        where = f" on {fault.channel}" if fault.channel else ""
        end = "on" if fault.end is None else f"to {fault.end:.3f} s"
        given = math.isfinite(fault.magnitude) and fault.magnitude != 0.0
        magnitude = f"  magnitude {fault.magnitude:.4g}" if given else ""
        text = f" {fault.number} {fault.kind}{where}  from {fault.onset:.3f} s {end}{magnitude}"
        lines.append(line(text, STRONG if fault.active else PLAIN))
    return lines + [line()] * (room + 1 - len(lines))


def _timing(picture: Picture, face: Face) -> list[Line]:
    status = picture.status
    missed, dropped = status["deadlines_missed"], status["messages_dropped"]
    lost = {topic: count for topic, count in picture.lost.items() if count}
    where = ", ".join(f"{topic} {count}" for topic, count in sorted(lost.items()))
    missing = f"{sum(lost.values())} messages lost: {where}" if lost else "no message lost"
    refused, reason = picture.refusals
    refused = max(refused, status["commands_rejected"])
    told = bool(picture.outcomes) and picture.outcomes[-1].text == reason
    timing = (
        f"{1e3 * status['lateness_max']:.1f} ms late   lag {1e3 * status['lag']:.1f} ms   "
        f"{missed} deadlines missed   {dropped} messages dropped"
    )
    return [
        line(f" {timing}", STRONG if missed or dropped else PLAIN),
        (
            (f" {status['commands_accepted']} commands accepted, ", PLAIN),
            (f"{refused} refused", STRONG if refused else PLAIN),
            (f"   {printable(missing)}", STRONG if lost else PLAIN),
        ),
        line(
            _cut(f" last refusal: {reason}", face.width) if refused and reason and not told else ""
        ),
    ]


def _outcome_lines(outcome: Outcome, face: Face) -> list[Line]:
    style = PLAIN if outcome.state in (DONE, WAITING) else ALARM
    text = printable(outcome_text(outcome))
    width = max(10, face.width)
    parts = textwrap.wrap(text, width, initial_indent=" > ", subsequent_indent="   ")
    return [line(part, style) for part in parts]


def _last_lines(parts: Sequence[Sequence[Line]], room: int) -> list[Line]:
    """Return the last lines of all parts, and blank ones for the rest of the room.

    If the last part alone is too long, its first line stays: it says what was refused.
    """
    if parts and len(parts[-1]) > room > 1:
        return [parts[-1][0], *parts[-1][1 - room :]]
    lines = [each for part in parts[-room:] for each in part][-room:]
    return lines + [line()] * (room - len(lines))


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: width - 3]}..."


def _watts(power: float) -> str:
    return f"{power + 0.0 if abs(power) >= 0.005 else 0.0:.2f} W"


def list_of(drills: Sequence[FoundDrill], face: Face) -> list[Line]:
    """Return the lines of a list of drills."""
    title = f" {len(drills)} drill{'' if len(drills) == 1 else 's'}"
    lines = [((f"{title:{face.width}}", HEADING),), line()]
    for number, drill in enumerate(drills, 1):
        texts = [f"{number:3}  {drill.namespace:24}", f"{drill.state:9}", f"{drill.regime:9}"]
        if drill.weight_on_bit is not None:
            texts.append(f"{drill.weight_on_bit:8.4g} N")
        if drill.active_faults:
            texts.append(f"{drill.active_faults} faults")
        lines.append(line(" ".join(texts), ALARM if drill.active_faults else PLAIN))
    if not drills:
        lines.append(line(" no drill is there: `rpud run` starts one"))
    return lines
