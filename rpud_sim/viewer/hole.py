"""Hole that a drill makes: layers of the rock, and rate and torque over the depth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpud_sim.drilling.rocks import ROCKS
from rpud_sim.drilling.strata import find_strata
from rpud_sim.foundation.quantities import ParameterError

_COLOURS = 6
_LOG_PARTS = 200  # of the depth, at most


def layers(parameters: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the layers of the rock that a run's parameters choose; none without a rock."""
    choice = str(parameters.get("strata") or "")
    if not choice:
        if parameters.get("rock_model", "none") == "none":
            return []
        return [{"from": 0.0, "to": None, "name": "rock", "colour": 0}]
    if not choice.lstrip().startswith("{") and choice not in ROCKS:
        return []  # a path: what is recorded or heard never makes this program read a file
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
        return {"depth": np.empty(0), "rate": np.empty(0), "torque": np.empty(0)}
    part = np.minimum((depth[valid] / greatest * _LOG_PARTS).astype(int), _LOG_PARTS - 1)
    used, places = np.unique(part, return_inverse=True)
    counts = np.bincount(places)

    def means(values: np.ndarray | None) -> np.ndarray:
        if values is None:
            return np.full(len(used), np.nan, np.float32)
        found: np.ndarray = np.bincount(places, values[valid]) / counts
        return found.astype(np.float32)

    centres = ((used + 0.5) * greatest / _LOG_PARTS).astype(np.float32)
    return {"depth": centres, "rate": means(rate), "torque": means(torque)}
