"""Tables of a report: what a drill did between its commands and faults, its energy, its origin."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from rpud_sim.bag.manifest import Manifest
from rpud_sim.pages.quantities import QUANTITIES
from rpud_sim.viewer.bins import Bins
from rpud_sim.viewer.impacts import Impacts

MOST_SEGMENTS = 100  # further ones are in the last
_LONGEST = 200  # characters of a cell
_NEAR = 1e-3  # boundaries that are closer are one [s]

# Fields of ``rpud_msgs/Status``, and their names in the picture.
INFLOWS = {
    "actuator_power": "work of the vibration",
    "weight_power": "weight on bit and gravity",
    "change_power": "changed parameters",
}
OUTFLOWS = {
    "absorbed_power": "drill tool and rock",
    "collision_power": "collisions of actuator and free mass",
    "load_damper_power": "damping of the load spring",
    "stored_power": "stored in motion and springs",
}
# Further fields, of a drill with a feed; NaN without one, and missing in earlier messages.
FEED_POWERS = ("weight_on_bit_power", "feed_power", "mount_power")

FEED = "feed"
GRAVITY = "gravity"
MOUNT = "arm, preload of the load spring and hole"

Table = dict[str, Any]  # ``title``, ``columns`` and ``rows``, as a frame has it


def segment_table(
    end: float,
    moments: Iterable[float],
    steps: Mapping[str, Mapping[str, np.ndarray]],
    faults: Sequence[Mapping[str, Any]],
    impacts: Impacts,
    bins: Bins,
    signals: Mapping[str, str],
) -> Table:
    """Return statistics of each segment between ``moments`` [s] until ``end`` [s].

    ``steps`` and ``faults`` are those of a frame; ``signals`` are the names in ``bins`` of the
    quantities ``reacting_force`` and ``absorbed_power``, as far as there are any.
    """
    begins = [0.0]
    for moment in sorted(moment for moment in moments if 0.0 < moment < end):
        if moment - begins[-1] > _NEAR:
            begins.append(moment)
    title = "segments between commands and faults"
    if len(begins) > MOST_SEGMENTS:
        title += f"; the last has {len(begins) - MOST_SEGMENTS} further ones"
        begins = begins[:MOST_SEGMENTS]
    rows = []
    for begin, until in pairwise([*begins, max(end, begins[-1])]):
        _, held = impacts.between(begin, until)
        peaks = held[np.isfinite(held)].astype(float)
        rows.append(
            [
                f"{begin:.3f}",
                f"{until:.3f}",
                _in_force(steps, begin + _NEAR),
                _active(faults, begin + _NEAR) or "none",
                str(len(held) * impacts.stride),
                _text("impact_rate", len(held) * impacts.stride / max(until - begin, 1e-9)),
                *(
                    _text("peak_force", float(figure))
                    for figure in (
                        (peaks.mean(), *np.quantile(peaks, (0.5, 0.95)), peaks.max())
                        if len(peaks)
                        else (math.nan,) * 4
                    )
                ),
                *(
                    _text(name, bins.mean(signals[name], begin, until) if name in signals else None)
                    for name in ("reacting_force", "absorbed_power")
                ),
            ]
        )
    columns = [
        *("begin [s]", "end [s]", "commands in force", "active faults", "impacts", "impacts [/s]"),
        *("peak force: mean [kN]", "median [kN]", "95 % [kN]", "greatest [kN]"),
        *("load on the mount: mean [N]", "power into tool and rock: mean [W]"),
    ]
    return {"title": title, "columns": columns, "rows": rows}


def energy_table(means: Mapping[str, float], seconds: float) -> Table | None:
    """Return the account of energy from mean powers [W] over a time; None if they are not known.

    ``means`` has the names of fields of ``rpud_msgs/Status``.
    """
    if not all(math.isfinite(means.get(name, math.nan)) for name in (*INFLOWS, *OUTFLOWS)):
        return None
    into, out = terms(
        {name: means.get(name, math.nan) for name in (*INFLOWS, *OUTFLOWS, *FEED_POWERS)}
    )
    came, went = sum(into.values()), sum(out.values())
    powers = [
        *((f"in: {text}", power) for text, power in into.items()),
        *((f"out: {text}", power) for text, power in out.items()),
        ("residual: in − out", came - went),
    ]
    if math.isfinite(electrical := means.get("electrical_power", math.nan)):
        powers.append(("electrical, drawn by the actuator", electrical))
    rows = [
        [
            text,
            f"{power * seconds:.4g}",
            _text("power", power),
            f"{100.0 * power / came:.3g}" if came > 0.0 else "–",
        ]
        for text, power in powers
    ]
    columns = ["term", "energy [J]", "mean power [W]", "share of what comes in [%]"]
    return {"title": f"energy account of {seconds:.1f} s", "columns": columns, "rows": rows}


def terms(powers: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Return inflows and outflows by their names in the picture, of either sign [W].

    Powers have the names of ``INFLOWS`` and ``OUTFLOWS``, and of ``FEED_POWERS`` if there are. With
    a feed, its work flows in, in place of that of the weight on bit: the weight on bit passes it on
    to the drill.
    """
    into = {text: powers[name] for name, text in INFLOWS.items()}
    out = {text: powers[name] for name, text in OUTFLOWS.items()}
    if all(math.isfinite(powers.get(name, math.nan)) for name in FEED_POWERS):
        weight = into.pop(INFLOWS["weight_power"])
        into[FEED] = powers["feed_power"]
        into[GRAVITY] = weight - powers["weight_on_bit_power"]
        out[MOUNT] = powers["mount_power"]
    return into, out


def run_tables(manifest: Manifest) -> list[Table]:
    """Return where a run came from, and its parameters if they are known."""
    origin = [
        ("drill", manifest.node),
        ("forked from", str(dict(manifest.forked_from)) if manifest.forked_from else ""),
        ("command", " ".join(manifest.command)),
        ("machine", manifest.machine),
        ("versions", ", ".join(f"{name} {text}" for name, text in manifest.versions.items())),
    ]
    parameters = [
        (name, f"{value:g}" if isinstance(value, float) else f"{value}")
        for name, value in sorted(manifest.parameters.items())
    ]
    return [
        {"title": title, "columns": [], "rows": [[name, text[:_LONGEST]] for name, text in rows]}
        for title, found in (("run", origin), ("parameters", parameters))
        if (rows := [pair for pair in found if pair[1]])
    ]


def _text(quantity: str, value: float | None) -> str:
    return QUANTITIES[quantity].text(value, unit=False)


def _in_force(steps: Mapping[str, Mapping[str, np.ndarray]], time: float) -> str:
    """Return the commands that are in force at a time [s]."""
    texts = []
    for name, found in steps.items():
        place = int(np.searchsorted(found["t"], time, "right")) - 1
        if name in ("weight_on_bit", "drive_voltage") and place >= 0:
            quantity, value = QUANTITIES[name], float(found["v"][place])
            texts.append(quantity.text(value) if value else f"no {quantity.label}")
    return ", ".join(texts) or "not known"


def _active(faults: Sequence[Mapping[str, Any]], time: float) -> str:
    return ", ".join(
        f"{fault['kind']} {fault['channel']}".strip().replace("_", " ")
        for fault in faults
        if fault["onset"] <= time and (fault["end"] is None or fault["end"] > time)
    )
