"""The picture of growth has a panel for each curve of the kept results."""

import re
from xml.etree import ElementTree

import pytest

from bench.growth import Point, points_of_rows, rows_of_points
from bench.page import SHOWN
from bench.results import Part, read_parts, rows_of, write_parts
from toolchain.pictures import growth

MACHINE = {"processor": "any", "cores": "2", "memory": "24 GiB", "system": "Linux"}


@pytest.fixture
def drawn(tmp_path, monkeypatch):
    def draw(points):
        rows = tuple(rows_of_points(points))
        part = Part("growth", "2026-11-22", "", False, MACHINE, (0.0, 0.0), 1.0, rows)
        write_parts(tmp_path / "kept.json", [part])
        monkeypatch.setattr(growth, "SHOWN", tmp_path / "kept.json")
        return growth.draw_growth()

    return draw


def test_a_curve_is_drawn_with_its_power_and_its_decades(drawn):
    amounts = (1.0, 10.0, 100.0, 1000.0)
    picture = drawn([Point("verify (seconds of bag)", n, 0.01 * n) for n in amounts])

    texts = [each.text for each in ElementTree.fromstring(picture).iter() if each.text]
    assert {"verify", "seconds of bag", "1", "10", "100", "1k", "0.01", "0.1"} <= {*texts}
    assert any(text.startswith("1.00 ±0.00") for text in texts)
    assert picture.count('class="dot"') == len(amounts)
    assert "prefers-color-scheme: dark" in picture


def test_dots_stay_within_their_panel(drawn):
    picture = drawn([Point("x (y)", n, cost) for n, cost in ((3.0, 0.2), (7.0, 0.21), (2e6, 99.0))])

    for x, y in re.findall(r'class="dot" cx="([^"]*)" cy="([^"]*)"', picture):
        assert 0.0 < float(x) < growth.WIDTH
        assert 0.0 < float(y) < growth.HEIGHT


def test_the_kept_picture_shows_every_kept_curve():
    curves = {point.curve for point in points_of_rows(rows_of(read_parts(SHOWN)))}

    picture = (SHOWN.parents[1] / "images/growth.svg").read_text(encoding="utf-8")

    assert picture == growth.draw_growth()
    assert picture.count('class="panel"') == len(curves) > 0
