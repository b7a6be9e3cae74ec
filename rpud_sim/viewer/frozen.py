"""Report of a bag: its screen, frozen into one HTML file."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.bag import BagFormatError
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST
from rpud_sim.bag.manifest import manifest_from_record
from rpud_sim.bag.tested import RECORD_NAME as TESTED
from rpud_sim.bag.tested import tested_from_record
from rpud_sim.inspection.damages import Damages
from rpud_sim.inspection.output import check_new_file, write_new_file
from rpud_sim.pages.quantities import QUANTITIES
from rpud_sim.viewer.frames import encode
from rpud_sim.viewer.page import frozen_page
from rpud_sim.viewer.recorded.signals import STATUS
from rpud_sim.viewer.recorded.store import Opened, RecordedStore
from rpud_sim.viewer.segments import energy_table, segment_table
from rpud_sim.viewer.store import ClientState, View

BINS = 3000  # of a layer, at most
SECTIONS = 12  # blocks of motion that a report keeps

_FINEST = 0.016  # shortest bin [s]: there are some impacts in each
_LONGEST = 200  # characters of a cell


class ReportError(Exception):
    """Report that cannot be written; the text gives the reason in one line."""


@dataclass(frozen=True)
class Reported:
    """What a report shows of a bag."""

    topics: int
    messages: int
    left_out: Mapping[str, str]  # reasons by topic
    damaged: Mapping[str, str]  # amount and reason by topic or record


def write_report(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    progress: Callable[[float], object] = lambda share: None,
) -> Reported:
    """Write the report of a bag into a new file; ``progress`` is told the share that was read."""
    check_new_file(out, ReportError)
    with RecordedStore(os.fspath(path)) as store:
        content = store.read_all(progress)
        client = ClientState(view=View(None, 0.0, np.inf, BINS))
        store.open(client)
        frame = store.frame(client) or {}
        recording = content.recording
        damages = Damages(recording.bag)
        frame |= {"number": 1, "mode": "frozen"}
        if "view" in frame:
            frame |= _overview(store, client.drill, frame)
        frame |= _sections(store, client.drill, frame)
        frame["report"] = _report(content, client.drill, frame, damages)
        name = Path(path).resolve().name
        write_new_file(out, frozen_page(f"{name} – report", encode(frame)), ReportError)
        summaries = recording.bag.readable_topics
        parts = {f"part {number}": reason for number, reason in recording.damages.items()}
        unreadable = {
            name: f"{reader.unreadable} of its messages: {reader.reason}"
            for name, reader in recording.readers.items()
            if reader.unreadable
        }
        return Reported(
            len(recording.readers),
            sum(each.message_count for each in summaries if each.topic.name in recording.readers),
            dict(recording.left_out),
            {**damages.texts, **parts, **unreadable},
        )


def _overview(store: RecordedStore, drill: str, frame: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``view`` over the whole run, and the plots that it serves: those of the table."""
    plots = [
        {**plot, "choices": [each for each in plot["choices"] if _of_table(each)] or plot["choices"][:1]}
        for plot in frame["plots"]
    ]
    names = {
        layer["quantity"] for plot in plots for each in plot["choices"] for layer in each["layers"]
    }
    count = int(min(BINS, max(frame["now"] / _FINEST, 1.0)))
    view = store.view(drill, 0.0, frame["now"], count, names)
    for layer in view["layers"].values():
        if all(np.array_equal(layer["mean"], layer.get(end), equal_nan=True) for end in ("low", "high")):
            del layer["low"], layer["high"]  # one value a bin
    return {"plots": plots, "view": view}


def _of_table(choice: Mapping[str, Any]) -> bool:
    return all(layer["quantity"] in QUANTITIES for layer in choice["layers"])


def _sections(store: RecordedStore, drill: str, frame: Mapping[str, Any]) -> dict[str, Any]:
    """Return the kept blocks of motion: the ends of equal parts of the run, and after each fault."""
    now = float(frame["now"])
    moments = [*np.linspace(0.0, now, SECTIONS + 1)[1:]]
    for fault in frame.get("faults", [])[: SECTIONS // 2]:
        after = min(float(fault["onset"]) + 0.1, now)
        moments[int(np.argmin(np.abs(np.array(moments) - after)))] = after
    found = [store.section(drill, moment) for moment in sorted({*moments})]
    sections = [section for section in found if section is not None]
    return {"sections": sections, "section": sections[-1]} if sections else {}


def _report(
    content: Opened, drill: str, frame: Mapping[str, Any], damages: Damages
) -> dict[str, Any]:
    bag, now, views = content.recording.bag, float(frame["now"]), content.views
    bins, impacts = content.overview.bins, content.overview.impacts[drill]
    faults = frame["faults"]
    moments = [entry["time"] for entry in frame["commands"]["list"]]
    moments += [fault[end] for fault in faults for end in ("onset", "end") if fault[end] is not None]
    tables = []
    if impacts.total:
        names = ("reacting_force", "absorbed_power")
        found = {name: views.signal(drill, name) for name in names}
        signals = {name: signal.name for name, signal in found.items() if signal is not None}
        tables.append(
            segment_table(now, moments, frame.get("steps", {}), faults, impacts, bins, signals)
        )
    means = {
        signal.column: bins.mean(signal.name, 0.0, now)
        for signal in content.recording.signals
        if signal.drill == drill and signal.type == STATUS
    }
    if account := energy_table(means, now):
        tables.append(account)
    seen: dict[str, Any] = {}
    for record in damages.records(bag, MANIFEST):
        try:
            manifest = manifest_from_record(record)
        except BagFormatError as error:
            damages.add_record(MANIFEST, error)
            continue
        if manifest.seed is not None:
            seen.setdefault("seed", str(manifest.seed))
        rows = [
            ["drill", manifest.node or "–"],
            *([["forked from", f"{dict(manifest.forked_from)}"[:_LONGEST]]] if manifest.forked_from else []),
            ["command", " ".join(manifest.command)[:_LONGEST] or "–"],
            ["machine", manifest.machine or "–"],
            ["versions", ", ".join(f"{k} {v}" for k, v in manifest.versions.items()) or "–"],
        ]
        tables.append({"title": "run", "columns": ["", ""], "rows": rows})
        if manifest.parameters:
            rows = [
                [name, f"{value:g}" if isinstance(value, float) else f"{value}"[:_LONGEST]]
                for name, value in sorted(manifest.parameters.items())
            ]
            tables.append({"title": "parameters", "columns": ["name", "value"], "rows": rows})
    for record in damages.records(bag, TESTED):
        try:
            seen |= tested_from_record(record).to_plain()
        except BagFormatError as error:
            damages.add_record(TESTED, error)
    return seen | {"tables": tables}
