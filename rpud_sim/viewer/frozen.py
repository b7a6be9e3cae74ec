"""Report of a bag: its screen, frozen into one HTML file."""

from __future__ import annotations

import base64
import hashlib
import html
import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.bag import BagFormatError
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST
from rpud_sim.bag.manifest import manifest_from_record
from rpud_sim.bag.tested import RECORD_NAME as TESTED
from rpud_sim.bag.tested import RunVerdict, tested_from_record
from rpud_sim.foundation.terminal import printable
from rpud_sim.inspection import InspectionError
from rpud_sim.inspection.output import Damages, check_new_file, write_new_file
from rpud_sim.pages.quantities import QUANTITIES
from rpud_sim.viewer.frames import encode
from rpud_sim.viewer.recorded.signals import STATUS
from rpud_sim.viewer.recorded.store import Opened, RecordedStore
from rpud_sim.viewer.report_tables import energy_table, run_tables, segment_table
from rpud_sim.viewer.store import ClientState, StoreError, View

BINS = 3000  # of a layer, at most
SECTIONS = 12  # blocks of motion that a report keeps

_FINEST = 0.016  # shortest bin [s]: there are some impacts in each


_IMPORT = re.compile(r'^import .*? from "\./([\w.]+)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=class|function|const|let)", re.MULTILINE)
_STYLE = re.compile(r'<link rel="stylesheet" href="[^"]*?([\w./]+\.css)">\n?')
_SCRIPT = re.compile(r'<script[^>]*src="[^"]*?([\w./]+\.js)"[^>]*></script>\n?')
_SHARE = "share/"


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
    drill: str = "",
) -> Reported:
    """Write the report of a drill in a bag, the first by default, into a new file."""
    check_new_file(out)
    with RecordedStore(os.fspath(path)) as store:
        content = store.read_all()
        client = ClientState(drill, View(None, 0.0, np.inf, BINS))
        try:
            store.open(client)
        except StoreError as error:
            raise InspectionError(str(error)) from None
        frame = store.frame(client) or {}
        recording = content.recording
        damages = Damages(recording.bag)
        others = [name for name in frame["drills"] if name != client.drill]
        frame |= {"number": 1, "mode": "frozen", "drills": [client.drill]}
        if others:
            frame["notice"] += f" The bag holds other drills: {', '.join(others):.200}."
        if "view" in frame:
            frame |= _overview(content, client.drill, frame)
        frame |= _sections(content, client.drill, frame)
        frame["report"] = _report(content, client.drill, frame, damages)
        name = Path(path).resolve().name
        write_new_file(out, frozen_page(f"{name} – report", encode(frame)))
        damaged = damages.texts
        damaged |= {f"part {number}": reason for number, reason in recording.damages.items()}
        damaged |= {
            name: f"{reader.unreadable} of its messages cannot be read"
            for name, reader in recording.readers.items()
            if reader.unreadable
        }
        left_out = {k: v for k, v in recording.left_out.items() if k not in damaged}
        shown = [
            summary.message_count
            for summary in recording.bag.readable_topics
            if summary.topic.name not in recording.left_out
        ]
        return Reported(len(shown), sum(shown), left_out, damaged)


def _overview(content: Opened, drill: str, frame: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``view`` over the whole run, and the plots that it serves: those of the table."""
    plots = []
    for plot in frame["plots"]:
        choices = [
            choice
            for choice in plot["choices"]
            if all(layer["quantity"] in QUANTITIES for layer in choice["layers"])
        ]
        plots.append({**plot, "choices": choices or plot["choices"][:1]})
    layers = [layer for plot in plots for each in plot["choices"] for layer in each["layers"]]
    count = int(min(BINS, max(frame["now"] / _FINEST, 1.0)))
    kinds = {layer["quantity"]: layer["kind"] for layer in layers}
    view = content.views.view(drill, 0.0, frame["now"], count, kinds)
    return {"plots": plots, "view": view}


def _sections(content: Opened, drill: str, frame: Mapping[str, Any]) -> dict[str, Any]:
    """Return the kept blocks of motion: at the ends of equal parts of the run, and after faults."""
    now = float(frame["now"])
    moments = [*np.linspace(0.0, now, SECTIONS + 1)[1:]]
    for fault in frame.get("faults", [])[: SECTIONS // 2]:
        after = min(float(fault["onset"]) + 0.1, now)
        moments[int(np.argmin(np.abs(np.array(moments) - after)))] = after
    found = [content.waveforms.section(drill, moment) for moment in sorted({*moments})]
    sections = [section for section in found if section is not None]
    return {"sections": sections, "section": sections[-1]} if sections else {}


def _report(
    content: Opened, drill: str, frame: Mapping[str, Any], damages: Damages
) -> dict[str, Any]:
    now, views = float(frame["now"]), content.views
    bins, impacts = content.overview.bins, content.overview.impacts[drill]
    faults = frame["faults"]
    moments = [entry["time"] for entry in frame["commands"]["list"]]
    moments += [
        fault[end] for fault in faults for end in ("onset", "end") if fault[end] is not None
    ]
    tables = []
    if impacts.total:
        names = ("reacting_force", "absorbed_power")
        known = {name: views.signal(drill, name) for name in names}
        signals = {name: signal.name for name, signal in known.items() if signal is not None}
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
    for name, read in ((MANIFEST, manifest_from_record), (TESTED, tested_from_record)):
        for record in damages.records(content.recording.bag, name):
            try:
                found = read(record)
            except BagFormatError as error:
                damages.add_record(name, error)
                continue
            if isinstance(found, RunVerdict):
                seen |= asdict(found)
            else:
                tables += run_tables(found)
                seen.setdefault("seed", found.seed)
    return seen | {"tables": tables}


def frozen_page(title: str, frame: bytes) -> str:
    """Return the screen with one frame, as one HTML file that needs no server and no network.

    Its policy allows no request, and no script or style but these, by their hashes.
    """
    text = _asset("screen.html")
    styles = "\n".join(_asset(name.removeprefix(_SHARE)) for name in _STYLE.findall(text))
    vendored, entry = (name.removeprefix(_SHARE) for name in _SCRIPT.findall(text))
    library, program = _asset(vendored), _joined(entry)
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(styles)}; "
        f"script-src {_hash(library)} {_hash(program)}; base-uri 'none'; form-action 'none'"
    )
    head = (
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{styles}</style>\n'
    )
    tail = (
        '<script type="application/octet-stream;base64" class="frame">'
        f"{base64.b64encode(frame).decode()}</script>\n"
        f'<script>{library}</script>\n<script type="module">{program}</script>\n</body>'
    )
    text = _SCRIPT.sub("", _STYLE.sub("", text))
    text = re.sub(
        "<title>.*?</title>",
        lambda _: f"<title>{html.escape(printable(title))}</title>\n{head}",
        text,
        count=1,
    )
    return text.replace("</body>", tail)


def _joined(entry: str) -> str:
    """Return a module and all that it imports as one, each after what it needs."""
    order: list[str] = []
    waiting: set[str] = set()

    def visit(name: str) -> None:
        if name in waiting:
            return
        waiting.add(name)
        for needed in _IMPORT.findall(_asset(name)):
            visit(needed)
        order.append(name)

    visit(entry)
    return "\n".join(_EXPORT.sub("", _IMPORT.sub("", _asset(name))) for name in order)


def _asset(name: str) -> str:
    return files("rpud_sim.viewer").joinpath("share", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
