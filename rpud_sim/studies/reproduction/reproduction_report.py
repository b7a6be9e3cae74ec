"""Files of a reproduction: an HTML report, all numbers, and validation.md."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from jinja2 import StrictUndefined, Template

from rpud_sim.foundation.whole_folder import whole_file
from rpud_sim.pages import figures  # noqa: F401 - where Bokeh is missing, it fails before a run
from rpud_sim.pages.frame import render_page
from rpud_sim.pages.plot import Plot
from rpud_sim.pages.words import described
from rpud_sim.studies.reproduction import findings, rows
from rpud_sim.studies.reproduction.captions import CAPTIONS, STUDY_CAPTIONS
from rpud_sim.studies.reproduction.contradictions import contradiction_rows
from rpud_sim.studies.reproduction.named_readings import AS_FIGURE_12
from rpud_sim.studies.reproduction.reproduction import Reproduction
from rpud_sim.studies.reproduction.run_plots import run_plots
from rpud_sim.studies.reproduction.study_plots import (
    bar_plots,
    readings_plots,
    search_plots,
    study_plots,
)
from rpud_sim.studies.reproduction.templates import BODY, HEADINGS, HOW_TO_READ, MARKDOWN
from rpud_sim.studies.reproduction.wording import show

REPORT = "report.html"
NUMBERS_FILE = "numbers.json"
VALIDATION = "validation.md"


def write_report(result: Reproduction, folder: Path, command: str) -> None:
    """Write the report, its numbers and validation.md into a folder.

    Args:
        folder: of the files; it is created if it does not exist.
        command: that generates the report; the report names it.

    Raises:
        OSError: if a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    context = _context(result, command)
    numbers = json.dumps(result.numbers(), indent=1, allow_nan=False, default=float)
    _write(folder / NUMBERS_FILE, f"{numbers}\n".encode())
    page = render_page(BODY, "The paper, reproduced", plots=_plots(result), **context)
    _write(folder / REPORT, page.encode())
    text = Template(MARKDOWN, undefined=StrictUndefined).render(**context)
    _write(folder / VALIDATION, f"{text.rstrip()}\n".encode())


def _write(path: Path, content: bytes) -> None:
    with whole_file(path) as unfinished:
        unfinished.write_bytes(content)


def _plots(result: Reproduction) -> dict[str, tuple[Plot, ...]]:
    found = {
        **run_plots(result.presets.reading, result.best.reading),
        **study_plots(result.studies),
        **bar_plots(result.bar),
        "readings": readings_plots(rows.named_fits(result)),
        "search": search_plots(result.search.ridges),
    }
    return {name: tuple(map(described, plots)) for name, plots in found.items()}


def _context(result: Reproduction, command: str) -> dict[str, Any]:
    slopes = {drill: result.slope(drill) for drill in result.studies}
    return {
        "command": command,
        "effort": findings.effort_text(result),
        "summary": findings.summary(result),
        "how_to_read": HOW_TO_READ,
        "headings": HEADINGS,
        "scores": rows.score_rows(result),
        "nodal_plane": show(result.extras[AS_FIGURE_12]["nodal_plane_mean"], "m"),
        "measured": rows.measured_rows(result),
        "named": [
            {"reading": fit.reading, "rows": rows.reading_rows(fit), "near": fit.near()}
            for fit in rows.named_fits(result)
        ],
        "numbers": rows.number_rows(result),
        "choices": rows.choice_rows(result),
        "contradictions": contradiction_rows(result),
        "trends": {drill: rows.trend_rows(result, drill) for drill in result.trends},
        "slopes": {drill: f"{slope:.3f} ± {half:.3f}" for drill, (slope, half) in slopes.items()},
        "bar": rows.bar_tables(result),
        "mesh": rows.mesh_rows(result),
        "tools": rows.tool_rows(),
        "figures": [
            {
                "name": name,
                "title": title,
                "paper": paper,
                "model": findings.captioned_values(result, keys),
            }
            for name, (title, paper, keys) in CAPTIONS.items()
        ],
        "study_figures": [
            {"name": name, "title": title, "paper": paper}
            for name, (title, paper) in STUDY_CAPTIONS.items()
        ],
    }
