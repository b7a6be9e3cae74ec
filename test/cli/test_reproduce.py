"""`rpud reproduce --quick`: the whole report, small."""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
from markupsafe import escape

from rpud_sim.studies.reproduction.choices import TOOLS
from rpud_sim.studies.reproduction.named_readings import NAMED
from rpud_sim.studies.reproduction.paper_numbers import NUMBERS

PLOTS = 4 * 2 + 2 + 2 * 2 + 2 + 1 + 4 * 4 + 1 + 1 + len(TOOLS) + 2 + 6
MOST_BYTES = 6_000_000


def rpud(*words):
    return subprocess.run(
        [sys.executable, "-m", "rpud_sim.cli.main", *words],
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reproduction") / "new"
    result = rpud("reproduce", "--quick", "--out", str(folder), "--json")
    assert result.returncode == 0, result.stderr
    for line in result.stderr.splitlines():
        assert re.match(r"[\w ,'-]+: +\d+% \d+/\d+ \[", line), "progress, every ten seconds"
    return folder, json.loads(result.stdout)


def test_the_report_stands_alone(made):
    folder, _ = made
    page = (folder / "report.html").read_text(encoding="utf-8")

    plots = re.findall(r'<figure class="plot" data-plot="(plot-\d+)"', page)
    assert len(plots) == len(set(plots)) == PLOTS
    assert page.count('<script type="application/json" class="plot-data"') == PLOTS
    assert {path.name for path in folder.iterdir()} == {
        *("report.html", "numbers.json", "validation.md")
    }
    own = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search("https?:| src=", own)
    assert len(page.encode()) < MOST_BYTES
    assert "default-src 'none'" in page, "a browser would load nothing"
    for figure in (3, 4, 5, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18):
        assert f"Fig. {figure}:" in page


def test_every_number_is_there_with_its_interval_under_every_reading(made):
    folder, numbers = made

    assert numbers == json.loads((folder / "numbers.json").read_text(encoding="utf-8"))
    assert set(numbers["numbers"]) == {number.key for number in NUMBERS}
    named = {reading.name for reading in NAMED}
    assert named <= {reading["name"] for reading in numbers["readings"]}
    assert len(numbers["readings"]) == len(NAMED) + 2 * len(TOOLS)
    close = [reading["close_figures"] for reading in numbers["readings"]]
    assert close == sorted(close, reverse=True)
    for reading in numbers["readings"]:
        assert bool(reading["reasons"]) == (reading["name"] in named)
        assert set(reading["values"]) == set(numbers["numbers"])
        for key, value in reading["values"].items():
            assert math.isfinite(value["mean"])
            assert value["standard_error"] >= 0.0
            assert value["low"] <= value["high"]
            paper = numbers["numbers"][key]["paper"]
            assert value["over_paper"] == pytest.approx(value["mean"] / paper)


def test_the_score_of_each_reading_is_written_and_colored(made):
    folder, numbers = made
    page = (folder / "report.html").read_text(encoding="utf-8")
    table = page[page.index('<h2 id="scores">') : page.index("<h3>Measured values")]

    colored = re.findall(r'<td class="([\w-]+)">([\d.]+)</td>', table)
    assert len(colored) == 10 * len(numbers["readings"])
    for grade, ratio in colored:
        assert (grade == "near") <= (0.895 <= float(ratio) <= 1.105)
        assert f"td.{grade} {{ background:" in page
    for reading in NAMED:
        assert f"<td>{escape(reading.name)}</td>" in table
        for reason in reading.reasons:
            assert escape(reason) in page
    assert "prefers-color-scheme:dark" in page


def test_undisputed_trends_are_found(made):
    _, numbers = made
    verdicts = {
        (trend["parameter"], trend["output"]): trend["verdict"]
        for trend in numbers["trends"]["presets"]
    }

    assert len(verdicts) == 16
    assert verdicts["actuator_restitution", "contact_force_mean"] == "rises"
    assert verdicts["free_mass", "drill_tool_impact_rate"] == "falls"
    assert verdicts["weight_on_bit", "reacting_force_mean"] == "rises"
    assert verdicts["weight_on_bit", "contact_force_mean"] == "flat"
    slope = numbers["reacting_force_over_weight_on_bit"]["presets"]
    assert slope["slope"] > 10.0 * slope["half_interval"]


def test_validation_names_its_command_and_every_number(made):
    folder, _ = made
    text = (folder / "validation.md").read_text(encoding="utf-8")

    assert "`rpud reproduce --quick --out DIR`" in text
    for number in NUMBERS:
        assert f"| {number.key} |" in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.endswith("|") for line in rows)


def test_the_validation_in_the_documents_is_of_this_kind(made):
    folder, _ = made
    document = Path(__file__).parents[2] / "docs" / "explanation" / "validation.md"
    texts = [path.read_text(encoding="utf-8") for path in (folder / "validation.md", document)]

    assert "`rpud reproduce --out DIR`" in texts[1]
    headings, tables = zip(*(outline(text) for text in texts), strict=True)
    assert headings[0] == headings[1]
    assert tables[0] == tables[1]


def outline(text):
    """Headings, and the heads of the tables."""
    lines = text.splitlines()
    heads = [lines[i - 1] for i, line in enumerate(lines) if line.startswith("|---")]
    return [line for line in lines if line.startswith("#")], heads


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    result = rpud("reproduce", "--quick", "--out", str(tmp_path / "file" / "folder"))

    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert "file" in result.stderr
