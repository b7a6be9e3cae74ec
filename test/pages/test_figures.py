"""Figures show the data of their plots, for files apart and for a server with shared models."""

import json

import numpy as np
import pytest
from bokeh.embed import json_item
from bokeh.models import DataRange1d, VSpan, VStrip

from rpud_sim.pages.figures import draw_column, draw_plot, mark_sources, standalone
from rpud_sim.pages.plot import (
    COMMAND,
    FAULT,
    GAP,
    Axis,
    Bars,
    Envelope,
    Line,
    Mark,
    Plot,
    Points,
    Rule,
    Spans,
    Stems,
    TimeColumn,
    Zone,
)
from rpud_sim.pages.theme import DARK, LIGHT

X = np.arange(4.0)
Y = np.array([1.0, np.nan, 3.0, 4.0])
LAYERS = (
    Line("line", X, Y, marker=True),
    Envelope("envelope", X, Y - 1.0, Y, Y + 1.0),
    Points("points", X, Y, Y - 0.1, Y + 0.1, joined=True),
    Bars("bars", np.arange(5.0), Y),
    Stems("stems", X, Y),
    Spans("spans", X, X + 1.0, X),
    Rule("rule", 2.0),
    Zone("zone", 1.0, 2.0),
)
MARKS = (
    Mark(COMMAND, 1.0, "weight on bit 5 N"),
    Mark(FAULT, 2.0, "bias", 3.0),
    Mark(FAULT, 3.5, "it lasts"),
    Mark(GAP, 0.5, "missing", 0.7),
)


@pytest.mark.parametrize("layer", LAYERS, ids=lambda layer: layer.name)
@pytest.mark.parametrize("live", [False, True])
def test_each_layer_is_drawn_with_its_data(layer, live):
    drawn = draw_plot(Plot("title", (layer,), y=Axis(unit="N")), "plot-1", live=live)
    assert drawn.figure.name == "plot-1"
    if isinstance(layer, Rule | Zone):
        assert not drawn.sources
    else:
        assert len(drawn.figure.renderers) >= 1
        assert layer.name in drawn.sources
    # A colour that is named is one of both themes, so that the page can change it.
    names = {
        name
        for model in drawn.figure.references()
        for tag in model.tags
        for name in json.loads(tag).get("paint", {}).values()
    }
    assert names <= LIGHT.keys() & DARK.keys()
    assert not live or isinstance(drawn.figure.y_range, DataRange1d)


def column(*plots):
    return TimeColumn(plots, 0.0, 4.0, MARKS)


def test_a_column_of_a_file_has_figures_that_stand_alone():
    one, two = draw_column(column(Plot("a", (LAYERS[0],)), Plot("b", (LAYERS[1],))), ("p", "q"))
    assert one.figure.x_range is not two.figure.x_range
    assert not {*one.figure.references()} & {*two.figure.references()}
    assert (one.figure.x_range.start, two.figure.x_range.end) == (0.0, 4.0)


def test_marks_are_on_every_plot_and_faults_have_their_ends():
    sources = mark_sources(MARKS, 4.0)
    assert list(sources[FAULT].data["time"]) == [2.0, 3.5]
    assert list(sources[FAULT].data["end"]) == [3.0, 4.0]  # one lasts
    assert list(sources[COMMAND].data["end"]) == [1.0]
    for drawn in draw_column(column(Plot("a", (LAYERS[0],)), Plot("b", ())), ("p", "q")):
        glyphs = [r.glyph for r in drawn.figure.renderers if r.name and r.name.startswith("mark")]
        assert [type(glyph) for glyph in glyphs] == [VStrip, VStrip, VSpan, VSpan, VSpan]


@pytest.mark.parametrize("layer", LAYERS, ids=lambda layer: layer.name)
def test_a_figure_is_embedded_as_bokeh_does(layer):
    figure = draw_plot(Plot("title", (layer,)), "plot-1").figure
    found = standalone(figure)
    assert json.dumps(found) == json.dumps(json_item(figure))
