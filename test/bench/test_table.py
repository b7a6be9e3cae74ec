"""Figures survive their file, a table shows them beside their goals, and pages show the rest."""

import numpy as np
import pytest

from bench.compare import ratio
from bench.page import PAGE, SHOWN, filled
from bench.table import Goal, Part, heading, read_parts, row, table, write_parts

PART = Part(
    "engine",
    "2026-11-22T12:00:00+00:00",
    "0123456",
    {"processor": "any", "cores": "2"},
    0.4,
    (
        row("engine, drilling: speed over that of C", [1.4, 1.7, 1.6], goal=Goal(least=1.5)),
        row("engine, free: speed over that of C", [1.2], goal=Goal(least=1.5)),
        row("engine: events", [3.1e6], "1/s"),
    ),
)


def test_a_table_shows_each_figure_beside_its_goal():
    assert list(table(PART.rows))[2:] == [
        "| engine, drilling: speed over that of C | 1.60 | 1.40 to 1.70 |  | >= 1.5 | yes |",
        "| engine, free: speed over that of C | 1.20 |  |  | >= 1.5 | **no** |",
        "| engine: events | 3,100,000 |  | 1/s |  |  |",
    ]
    assert next(heading([PART])) == "Measured on processor any, cores 2."


def test_results_survive_their_file(tmp_path):
    write_parts(tmp_path / "kept" / "engine.json", [PART, PART])

    assert read_parts(tmp_path / "kept" / "engine.json") == [PART, PART]


def test_the_figures_of_the_page_are_those_of_the_kept_results():
    text = PAGE.read_text(encoding="utf-8")

    assert text == filled(text, read_parts(SHOWN))


def test_every_missed_goal_is_explained():
    explained = PAGE.read_text(encoding="utf-8").partition("Which parts miss their goals")[2]

    for part in read_parts(SHOWN):
        if any(each.missed for each in part.rows):
            assert f"- **{part.measurement}**" in explained


def pairs(factor, count=8, noise=0.02, seed=5):
    """Return times with a spread, on a machine that becomes slower as they are taken."""
    machine = 2.0 + np.arange(count) / count
    spread = np.exp(np.random.default_rng(seed).normal(0.0, noise, (count, 2)))
    return [(m * a, m * b * factor) for m, (a, b) in zip(machine, spread, strict=True)]


@pytest.mark.parametrize(
    ("factor", "verdict"),
    [(1.0, "no difference seen"), (1.01, "no difference seen"), (1.2, "slower"), (0.8, "faster")],
)
def test_a_verdict_is_that_of_the_ratio(factor, verdict):
    found = ratio(pairs(factor))

    assert str(found).startswith(f"{verdict}: ")
    assert found.value == pytest.approx(factor, rel=0.03)
