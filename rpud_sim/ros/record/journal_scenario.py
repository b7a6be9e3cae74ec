"""Scenario of a drill from its journal. No numba, so that the recorder starts soon."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from rpud_sim.foundation.time import SECOND


def scenario_text(content: str) -> str:
    """Return the scenario of a journal's entry ``begin`` as the text of a file, all faults drawn.

    The text is one JSON object, which YAML reads too; it is empty if no fault was planned. Other
    content raises a ValueError.
    """
    try:
        faults = [_planned(entry) for entry in json.loads(content)["faults"]]
    except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise ValueError(f"no beginning of a journal: {error!r:.100}") from None
    return json.dumps({"faults": faults}, indent=1) + "\n" if faults else ""


def _planned(entry: Mapping[str, Any]) -> dict[str, Any]:
    onset, clear = entry["onset"], entry["clear"]
    planned: dict[str, Any] = {"kind": str(entry["kind"]), "onset": int(onset) / SECOND}
    if entry["channel"]:
        planned["channel"] = str(entry["channel"])
    if clear is not None:
        planned["duration"] = (int(clear) - int(onset)) / SECOND
    if math.isfinite(entry["magnitude"]):
        planned["magnitude"] = float(entry["magnitude"])
    return planned
