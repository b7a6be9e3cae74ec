"""A fast validation agrees with the page of the documents, and both with what we say of them."""

import csv
from pathlib import Path

import pytest

from rpud_sim.simulation import preset, to_configuration
from rpud_sim.simulation.configuration import read_parameter_file
from validation.choices import AS_FIGURE_12, FITTED, NAMED, REASONED, TABLES, named
from validation.numbers import MEASURED, SIMULATED
from validation.page import FILES, contradiction_table, page, tool_table
from validation.scores import Effort, run_validation

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "explanation" / "validation.md"
TEXT = PAGE.read_text(encoding="utf-8")

# All of the paper's numbers are computed again, which takes long.
pytestmark = pytest.mark.extended

# The fifth percentile of the forces is a mean over few impacts of each run.
LOOSE = "Fig. 11 low"


@pytest.fixture(scope="module")
def results():
    return run_validation(Effort(12, 4, 6.0, 20, seed=7))


def table_of(name):
    """Return the rows of a table beside the page."""
    with (PAGE.with_suffix("") / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def test_the_page_has_the_sections_and_tables_that_are_made(results):
    def shape(text):
        return [line for line in text.splitlines() if line.startswith(("#", "| ---", "| [num"))]

    assert shape(TEXT) == shape(page(results))
    for name, (_, make) in FILES.items():
        made = make(results)
        assert table_of(name)[0] == list(made.heading)
        assert len(table_of(name)) == 1 + len(made.rows)


def near(cell, value, number):
    allowed = 3.0 * value.half_interval / number.paper + 0.006
    return float(cell.strip("*")) == pytest.approx(value.over(number), abs=allowed)


def test_the_ten_numbers_on_the_page_are_those_of_the_model(results):
    heading, *cells = table_of("scores")
    rows = {row[0]: row for row in cells}

    assert heading[1:11] == [number.label for number in SIMULATED]
    assert set(rows) == {choices.name for choices in NAMED}
    for fit in results.fits:
        cells = rows[fit.choices.name]
        for number, cell in zip(SIMULATED, cells[1:11], strict=True):
            assert near(cell, fit.values[number], number), number.label
        within = sum(abs(float(cell.strip("*")) - 1.0) <= 0.1 for cell in cells[1:11])
        assert cells[11] == f"{within} of 10"
        shown = f"| {' | '.join(cells)} |" in TEXT
        assert shown == (fit.choices.name in (FITTED, REASONED, TABLES))


def test_the_measured_numbers_are_those_of_the_model(results):
    heading, *rows = table_of("measured")
    cells = {row[0]: row[1:] for row in rows}

    assert heading[1:] == [number.label for number in MEASURED]
    for fit in results.fits:
        for number, cell in zip(MEASURED, cells[str(fit.choices.before)], strict=True):
            assert near(cell, fit.values[number], number), number.label


def test_the_verdicts_on_trends_are_those_of_the_model(results):
    rows = table_of("trends")[1:]
    assert len(rows) == 16
    for number, name in ((2, TABLES), (3, FITTED)):
        stated = {(row[0], row[1]): row[number].partition(",")[0] for row in rows}
        found = {(trend.parameter, trend.output): trend.verdict for trend in results.trends[name]}
        assert found == stated


def test_what_needs_no_runs_is_there_to_the_letter(results):
    assert table_of("tools") == [list(row) for row in (tool_table().heading, *tool_table().rows)]
    stated = [row[:3] for row in table_of("contradictions")[1:]]
    assert stated == [list(row[:3]) for row in contradiction_table(results).rows]
    assert {row[0]: row[1:] for row in table_of("choices")[1:]} == {
        choices.name: [str(choices.before), str(choices.rock), choices.reasons] for choices in NAMED
    }


def outside(fit):
    return [number.label for number in SIMULATED if not fit.values[number].near(number)]


def test_with_the_tool_of_figure_12_at_least_nine_of_ten_numbers_are_reached(results):
    assert len(SIMULATED) == 10
    assert set(outside(results.fit(AS_FIGURE_12))) <= {LOOSE}
    assert set(outside(results.fit(FITTED))) <= {LOOSE}
    assert results.fit(FITTED).misfit() < 0.08


def test_without_fitting_the_numbers_are_near_and_the_tables_are_far_off(results):
    reasoned = results.fit(REASONED)

    assert reasoned.near() >= 6
    assert reasoned.misfit() < 0.15
    assert results.fit(TABLES).near() <= 1
    assert results.fit(TABLES).misfit() > 1.0


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_the_default_and_its_file_are_the_fitted_choices(regime):
    def of_file(name):
        values = read_parameter_file(ROOT / "config" / f"{name}_{regime}.yaml".lstrip("_"))
        return to_configuration(values).parameters

    assert preset(regime) == named(FITTED).parameters(regime) == of_file("")
    tables = named(TABLES).parameters(regime)
    # The choices of a regime leave the other one's tool open.
    open_tool = {"free": "contact_model", "drilling": "drill_tool_mass"}[regime]
    assert of_file("tables") == tables.replace(**{open_tool: getattr(of_file("tables"), open_tool)})
