"""Borehole as a screen draws it: layers of the rock, and a log of rate and torque by depth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rpud_sim.drilling.rock import ROCKS, find_strata
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.values import to_float32

if TYPE_CHECKING:
    from rpud_sim.viewer.history import History

_COLOURS = 6  # of layers of the rock
_LOG_PARTS = 200  # of the depth, at most
_LOG_BINS = 4000  # of the run, for rate and torque over the depth


def hole_of(history: History, now: float) -> dict[str, Any] | None:
    """Return the field ``hole`` of a frame at a time [s]; None without a rock or a depth."""
    layers, bins = rock_layers(history.commands.parameters), history.bins[-1]
    shown, rates, torques = map(history.signal, ("depth", "penetration_rate", "torque"))
    if not layers or shown is None or rates is None:
        return None
    end = max(now, bins.width)

    def means(signal: Any) -> np.ndarray:
        return np.asarray(bins.view(signal.name, 0.0, end, _LOG_BINS)["mean"])

    depth = means(shown)
    latest = history.latest(shown, now)
    if latest is None:
        latest = next((each for each in depth[::-1] if np.isfinite(each)), 0.0)
    arm = history.signal("mount_position")  # at the depth of the hole the bit touches the rock
    tip = history.latest(arm, now) if arm else None
    log = well_log(depth, means(rates), means(torques) if torques else None)
    return {"depth": latest, "tip": tip, "layers": layers, "log": log}


def rock_layers(parameters: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the layers of the rock that a run's parameters choose; none without a rock."""
    choice = str(parameters.get("strata") or "")
    if not choice:
        if parameters.get("rock_model", "none") == "none":
            return []
        return [{"from": 0.0, "to": None, "name": "rock", "colour": 0}]
    if not choice.lstrip().startswith("{") and choice not in ROCKS:
        return []  # a path: no recorded or received text makes this program read a file
    try:
        strata = find_strata(choice)
    except ParameterError:  # another program wrote it
        return []
    names = list(dict.fromkeys(layer.name for layer in strata.layers))
    return [
        {
            "from": layer.depth_from,
            "to": end if np.isfinite(end := strata.end_of(number)) else None,
            "name": layer.name,
            "colour": names.index(layer.name) % _COLOURS,
        }
        for number, layer in enumerate(strata.layers)
    ]


def well_log(
    depth: np.ndarray, rate: np.ndarray, torque: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Return means of rate [m/s] and torque [N m] over equal parts of the depth [m].

    All have one value for each moment, shape (n,); what is not finite is left out.
    """
    valid = np.isfinite(depth) & np.isfinite(rate) & (depth >= 0.0)
    greatest = float(depth[valid].max(initial=0.0))
    if greatest <= 0.0:
        return dict.fromkeys(("depth", "rate", "torque"), np.empty(0))
    part = np.minimum((depth[valid] / greatest * _LOG_PARTS).astype(int), _LOG_PARTS - 1)
    used, places, counts = np.unique(part, return_inverse=True, return_counts=True)
    log = {"depth": (used + 0.5) * greatest / _LOG_PARTS}
    log["rate"] = np.bincount(places, rate[valid]) / counts
    none = np.full(len(used), np.nan)
    log["torque"] = none if torque is None else np.bincount(places, torque[valid]) / counts
    return {name: to_float32(values) for name, values in log.items()}
