"""Report of a bag: its screen, frozen into one HTML file, with tables."""

from __future__ import annotations

import base64
import hashlib
import html
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.bag import BagFormatError
from rpud_sim.bag.own_records import (
    MANIFEST_RECORD,
    VERDICT_RECORD,
    Manifest,
    RunVerdict,
    manifest_from_record,
    tested_from_record,
)
from rpud_sim.foundation.shown_quantities import QUANTITIES
from rpud_sim.foundation.terminal import printable
from rpud_sim.recorded.output import SkippedParts, check_new_file, write_new_file
from rpud_sim.simulation.fault_kinds import fault_text
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.commands import COMMAND, FAILURE, RUN
from rpud_sim.viewer.frames import ClientState, View, encode
from rpud_sim.viewer.recorded import RecordedDrill, RecordedStore

BINS = 3000  # of a layer, at most
MOMENTS = 12  # whose motion and numbers a report keeps

_FINEST = 0.016  # shortest bin [s]: there are some impacts in each
MOST_SEGMENTS = 100  # further ones are in the last
_LONGEST = 200  # characters of a cell
_NEAR = 1e-3  # boundaries that are closer are one [s]

Table = dict[str, Any]  # ``title``, ``columns`` and ``rows``, as a frame has it

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
    path: str | os.PathLike[str], out: str | os.PathLike[str], drill: str = ""
) -> Reported:
    """Write the report of a drill in a bag, the first by default, into a new file."""
    check_new_file(out)
    with RecordedStore(os.fspath(path)) as store:
        store.read_all()
        client = ClientState(drill, View(None, 0.0, np.inf, BINS))
        store.open(client)
        recording, damages = store.recording, SkippedParts(store.recording.bag)
        history, frame = store.histories[client.drill], store.frame(client) or {}
        frozen = _frame(history, frame, damages)
        title = f"{Path(path).resolve().name} – report"
        page = frozen_page(title, encode(frozen), without_scripts(frozen))
        write_new_file(out, page)
        damaged = damages.texts
        damaged |= {f"part {number}": reason for number, reason in recording.damages.items()}
        damaged |= {
            name: f"{reader.unreadable} of its messages cannot be read"
            for name, reader in recording.readers.items()
            if reader.unreadable
        }
        left_out = {k: v for k, v in recording.left_out.items() if k not in damaged}
        readable = recording.bag.readable_topics
        shown = [each for each in readable if each.topic.name not in recording.left_out]
        return Reported(len(shown), sum(each.message_count for each in shown), left_out, damaged)


def _frame(history: RecordedDrill, frame: dict[str, Any], damages: SkippedParts) -> dict[str, Any]:
    """Return the one frame of a report, from the first one of a screen."""
    now, drill = float(frame["now"]), history.drill
    others = [name for name in frame["drills"] if name != drill]
    frame |= {"number": 1, "mode": "frozen", "drills": [drill]}
    if others:
        frame["notice"] += f" The bag holds other drills: {', '.join(others):.200}."
    for plot in frame["plots"]:  # the overview has the quantities of the table
        known = [
            choice
            for choice in plot["choices"]
            if all(layer["quantity"] in QUANTITIES for layer in choice["layers"])
        ]
        plot["choices"] = known or plot["choices"][:1]
    choices = [choice for plot in frame["plots"] for choice in plot["choices"]]
    kinds = {layer["quantity"]: layer["kind"] for each in choices for layer in each["layers"]}
    frame["view"] = history.view(0.0, now, int(min(BINS, max(now / _FINEST, 1.0))), kinds)
    # Moments at the ends of equal parts of the run, and after faults.
    moments = np.linspace(0.0, now, MOMENTS + 1)[1:]
    for fault in frame["faults"][: MOMENTS // 2]:
        after = min(float(fault["onset"]) + 0.1, now)
        moments[np.argmin(np.abs(moments - after))] = after
    frame["moments"] = [_moment(history, time) for time in np.unique(moments).tolist()]
    frame.pop("section", None)
    frame["report"] = report = _report(history, frame, damages)
    failed = [{"time": at, "kind": FAILURE, "text": "failed"} for at in report.get("failed_at", ())]
    frame["log"] = sorted([*frame["log"], *failed], key=lambda entry: float(entry["time"]))
    return frame


def _moment(history: RecordedDrill, time: float) -> dict[str, Any]:
    section = history.section(time)
    frame = history.moment(time) | ({"section": section} if section else {})
    return {"time": time, "frame": frame}


def _report(
    history: RecordedDrill, frame: Mapping[str, Any], damages: SkippedParts
) -> dict[str, Any]:
    now, [bins] = float(frame["now"]), history.bins
    tables = []
    if history.impacts.total:
        tables.append(segment_table(history, frame))
    means = {
        signal.column: bins.mean(signal.name, 0.0, now)
        for signal in history.own_signals
        if signal.type == TOPICS["power"].type and signal.column.endswith("_power")
    }
    rows = [
        [name.replace("_", " "), f"{power * now:.4g}", _text("power", power)]
        for name, power in means.items()
        if math.isfinite(power)
    ]
    if rows:
        columns = ["power", "energy [J]", "mean [W]"]
        title = f"powers over {now:.1f} s"
        tables.append({"title": title, "columns": columns, "rows": rows})
    seen: dict[str, Any] = {}
    for name, read in (
        (MANIFEST_RECORD, manifest_from_record),
        (VERDICT_RECORD, tested_from_record),
    ):
        for record in damages.records(history.recording.bag, name):
            try:
                found = read(record)
            except BagFormatError as error:
                damages.add_record(name, error)
                continue
            if isinstance(found, RunVerdict):
                seen |= asdict(found)
            else:
                tables.append(run_table(found))
                seen.setdefault("seed", found.seed)
    return seen | {"tables": tables}


def without_scripts(frame: Mapping[str, Any]) -> str:
    """Return HTML of verdict and numbers of a report, for who opens it where scripts are blocked.

    The screen removes it. An element ``noscript`` would be hidden where a policy blocks scripts.
    """
    report = frame["report"]
    parts = [f"<p>Drill {_escaped(frame['drill'])}, {float(frame['now']):.6g} s.</p>"]
    if report.get("verdict"):
        said = "".join(f"<li>{_escaped(line)}</li>" for line in report["requirements"])
        verdict = f"{report['verdict']} \N{MIDDLE DOT} {report['test']}"
        parts.append(f"<h2>{_escaped(verdict)}</h2><ul>{said}</ul>")
    parts.append(
        "<p>Plots and motion are missing: they need scripts, which are blocked here. "
        "Save this file and open it in a browser.</p>"
    )
    for table in report["tables"][:2]:
        heads = "".join(f'<th scope="col">{_escaped(each)}</th>' for each in table["columns"])
        rows = ["".join(f"<td>{_escaped(each)}</td>" for each in row) for row in table["rows"]]
        body = "".join(f"<tr>{row}</tr>" for row in [heads, *rows])
        parts.append(f"<table><caption>{_escaped(table['title'])}</caption>{body}</table>")
    return f'<section class="static" aria-label="summary">{"".join(parts)}</section>'


def _escaped(value: object) -> str:
    return html.escape(printable(str(value)))


def frozen_page(title: str, frame: bytes, summary: str) -> str:
    """Return the screen with one frame, as one HTML file that needs no server and no network.

    ``summary`` is HTML that is shown without scripts.

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
    text = text.replace("<main>", f"<main>{summary}").replace(">searching<", "><")
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
    return (files("rpud_sim.viewer") / "share" / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def segment_table(history: RecordedDrill, frame: Mapping[str, Any]) -> Table:
    """Return statistics of each segment between commands and faults of a frame."""
    end, faults = float(frame["now"]), frame["faults"]
    impacts, [bins] = history.impacts, history.bins
    moments = [entry["time"] for entry in frame["log"] if entry["kind"] in (COMMAND, RUN)]
    moments += [fault[name] for fault in faults for name in ("onset", "end")]
    begins = [0.0]
    for moment in sorted(moment for moment in moments if moment and 0.0 < moment < end):
        if moment - begins[-1] > _NEAR:
            begins.append(moment)
    title = "segments between commands and faults"
    if frame["log_thinned"]:
        title += f", without {frame['log_thinned']} older commands"
    if len(begins) > MOST_SEGMENTS:
        title += f"; the last has {len(begins) - MOST_SEGMENTS} further ones"
        begins = begins[:MOST_SEGMENTS]
    rows = []
    for begin, until in pairwise([*begins, max(end, begins[-1])]):
        _, held = impacts.between(begin, until)
        peaks, count = held[np.isfinite(held)].astype(float), len(held) * impacts.stride
        figures = {"impact_rate": [count / max(until - begin, 1e-9)], "peak_force": [math.nan] * 4}
        if len(peaks):
            spread = peaks.mean(), *np.quantile(peaks, (0.5, 0.95)), peaks.max()
            figures["peak_force"] = [float(each) for each in spread]
        for name in ("reacting_force", "absorbed_power"):
            signal = history.signal(name)
            figures[name] = [bins.mean(signal.name, begin, until) if signal else math.nan]
        row = [f"{begin:.3f}", f"{until:.3f}", _in_force(frame.get("steps", {}), begin + _NEAR)]
        row += [_active(faults, begin + _NEAR) or "none", str(count)]
        rows.append(row + [_text(name, each) for name in figures for each in figures[name]])
    columns = [
        *("begin [s]", "end [s]", "active commands", "active faults", "impacts", "impacts [/s]"),
        *("peak force: mean [kN]", "median [kN]", "95 % [kN]", "greatest [kN]"),
        *("reacting force: mean [N]", "power into tool and rock: mean [W]"),
    ]
    return {"title": title, "columns": columns, "rows": rows}


def run_table(manifest: Manifest) -> Table:
    """Return where a run came from; the journal has its parameters."""
    origin = {
        "drill": manifest.node,
        "forked from": str(dict(manifest.forked_from)) if manifest.forked_from else "",
        "command": " ".join(manifest.command),
        "machine": manifest.machine,
        "versions": ", ".join(f"{name} {text}" for name, text in manifest.versions.items()),
    }
    rows = [[name, text[:_LONGEST]] for name, text in origin.items() if text]
    return {"title": "run", "columns": [], "rows": rows}


def _text(quantity: str, value: float | None) -> str:
    return QUANTITIES[quantity].text(value, unit=False)


def _in_force(steps: Mapping[str, Mapping[str, np.ndarray]], time: float) -> str:
    """Return the commands that are active at a time [s]."""
    texts = []
    for name, found in steps.items():
        place = int(np.searchsorted(found["t"], time, "right")) - 1
        if name in ("weight_on_bit", "drive_voltage") and place >= 0:
            quantity, value = QUANTITIES[name], float(found["v"][place])
            texts.append(quantity.text(value) if value else f"no {quantity.label}")
    return ", ".join(texts) or "not known"


def _active(faults: Sequence[Mapping[str, Any]], time: float) -> str:
    return ", ".join(
        fault_text(fault["kind"], fault["channel"]).replace("_", " ")
        for fault in faults
        if fault["onset"] <= time and (fault["end"] is None or fault["end"] > time)
    )
