"""Results are kept whole, a measurement that fails loses only itself, and pages show the rest."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench import results
from bench.__main__ import MEASUREMENTS, Keeper, find_measurement
from bench.page import PAGES, SHOWN, filled
from bench.results import Part, newest_parts, number, read_parts, summary, table, write_parts
from bench.row import Goal, Row, row

PART = Part(
    "engine",
    "2026-11-22T12:00:00+00:00",
    "0" * 40,
    False,
    {"processor": "any", "cores": "2", "memory": "24 GiB", "system": "Linux", "Python": "3.11"},
    (0.5, 1.5),
    12.5,
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
    assert list(summary([PART, replace(PART, rows=(), failure="OSError: gone")])) == [
        "1 of 2 goals are met.",
        "missed: engine, free: speed over that of C: 1.20, goal >= 1.5",
        "failed: engine: OSError: gone",
    ]


@given(
    st.lists(
        st.builds(
            row,
            st.text(max_size=20),
            st.lists(st.floats(width=16, allow_infinity=False), min_size=1, max_size=4),
            st.text(max_size=3),
            st.none() | st.builds(Goal, st.floats(0.0, 9.0, width=16), st.none()),
        ),
        max_size=4,
    )
)
def test_results_survive_their_file(tmp_path_factory, rows):
    file = tmp_path_factory.mktemp("kept") / "results.json"
    part = replace(PART, rows=tuple(rows))

    write_parts(file, [part, PART])

    read, other = read_parts(file)
    assert other == PART
    assert replace(read, rows=()) == replace(part, rows=())
    assert [(r.name, r.unit, r.goal) for r in read.rows] == [(r.name, r.unit, r.goal) for r in rows]
    for ours, theirs in zip(read.rows, rows, strict=True):
        assert ours.values == pytest.approx(theirs.values, rel=1e-5, nan_ok=True)


@pytest.mark.parametrize("content", ["", "[]", '{"parts": [{}]}', '{"parts": 3}'])
def test_another_file_is_told(tmp_path, content):
    (tmp_path / "x.json").write_text(content)

    with pytest.raises(ValueError, match=r"x\.json does not hold results of the bench"):
        read_parts(tmp_path / "x.json")


def test_the_newest_whole_result_of_each_measurement_counts(tmp_path):
    later = replace(PART, began="2026-11-23T12:00:00+00:00", seconds=1.0)
    failed = replace(PART, began="2026-11-24T12:00:00+00:00", failure="interrupted")
    write_parts(tmp_path / "b.json", [later, replace(PART, measurement="start")])
    write_parts(tmp_path / "a.json", [failed])
    write_parts(tmp_path / "c.json", [PART])

    assert newest_parts(tmp_path) == [later, replace(PART, measurement="start")]


def test_a_measurement_that_fails_loses_neither_its_rows_nor_the_others(tmp_path, monkeypatch):
    monkeypatch.setattr(results, "KEPT", tmp_path)
    keeper = Keeper()

    def fails():
        yield row("first", [1.0])
        raise OSError("no such\ndevice")

    keeper.measure("broken", fails)
    keeper.measure("whole", lambda: [row("second", [2.0], "s")])

    [file] = tmp_path.glob("*.json")
    broken, whole = read_parts(file)
    assert broken.failure == "OSError: no such device"
    assert [each.name for each in broken.rows] == ["first"]
    assert (whole.failure, whole.rows) == ("", (Row("second", (2.0,), "s"),))
    assert {"processor", "cores", "Python", "numpy"} <= whole.machine.keys()


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_each_measurement_is_there(name):
    if name == "watch":
        pytest.importorskip("playwright")
    assert find_measurement(name)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.01234, "0.0123"),
        (9.999, "10.0"),
        (123.4, "123"),
        (31234.0, "31,200"),
        (-2.5, "-2.50"),
        (1.5e9, "1.5e+09"),
        (1.5e-7, "1.5e-07"),
        (math.nan, "nan"),
        (math.inf, "inf"),
    ],
)
def test_a_number_has_three_digits(value, text):
    assert number(value) == text


def test_a_page_is_filled_between_its_markers_alone():
    text = "# Page\n<!-- figures: speed -->\nold\n<!-- end of figures -->\nrest\n"

    page = filled(text, [PART])

    assert page == (
        "# Page\n<!-- figures: speed -->\n\n"
        "| on one core | drilling | before drilling |\n|---|---|---|\n"
        "| times as fast as C | 1.60 | 1.20 |\n\n"
        "<!-- end of figures -->\nrest\n"
    )
    assert filled(page, [PART]) == page
    measured = replace(PART, rows=(row("profile, verify of 9 s: bag/reader.py", [41.25], "%"),))
    assert "| verify of 9 s | bag/reader.py 41.2 % |" in filled(
        "<!-- figures: profiles -->\n<!-- end of figures -->", [measured]
    )
    with pytest.raises(KeyError):
        filled("<!-- figures: other -->\n<!-- end of figures -->", [PART])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_figures_of_a_page_are_those_of_the_kept_results(page):
    text = page.read_text(encoding="utf-8")

    assert text == filled(text, read_parts(SHOWN))


def test_every_missed_goal_is_explained():
    page = PAGES[0].read_text(encoding="utf-8").partition("\n## What misses its goal\n")[2]
    explained = page.partition("<!-- end of figures -->")[2].partition("\n## ")[0]

    for part in read_parts(SHOWN):
        if any(row.missed for row in part.rows):
            assert f"**{part.measurement}**" in explained
