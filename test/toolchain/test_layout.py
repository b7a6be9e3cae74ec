"""A layout's plots, drawn of a bag."""

import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from sample_bags import write_offline_bag

import rpud_sim.bag
from rpud_sim.bag import BagError
from rpud_sim.simulation import preset
from toolchain.pictures.layout import draw, main, read_plots

LAYOUT = Path(__file__).resolve().parents[2] / "config" / "foxglove.json"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("layout") / "bag"
    write_offline_bag(path, preset("drilling"), 1.5)
    return path


def test_every_series_of_the_layout_is_drawn_of_every_message(bag):
    plots = read_plots(LAYOUT)
    with rpud_sim.bag.open(bag) as reader:
        figure = draw(reader, plots)
        counts = {item.topic.name: item.message_count for item in reader.topics}
    assert isinstance(figure, Figure)
    assert [axes.get_title("left") for axes in figure.axes] == [
        plot["foxglovePanelTitle"] for plot in plots
    ]
    for axes, plot in zip(figure.axes, plots, strict=True):
        for line, series in zip(axes.lines, plot["paths"], strict=True):
            assert len(line.get_xdata()) == counts[series["value"].split(".")[0]] > 0


def test_the_picture_is_a_file(bag, tmp_path, monkeypatch):
    out = tmp_path / "new" / "live.png"
    monkeypatch.setattr("sys.argv", ["layout_picture", str(bag), str(LAYOUT), str(out)])
    assert main() == 0
    assert out.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("text", "said"),
    [("{", "is no layout"), ("[]", "is no layout"), ('{"configById": {}}', "has no plots")],
)
def test_what_is_no_layout_is_one_line(bag, tmp_path, monkeypatch, capsys, text, said):
    layout = tmp_path / "layout.json"
    layout.write_text(text)
    monkeypatch.setattr("sys.argv", ["layout_picture", str(bag), str(layout), "out.png"])
    assert main() == 1
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("value", ["/rpud/contact_force.colour", "/rpud/nowhere.position"])
def test_a_series_that_is_not_there_is_named(bag, value):
    plots = json.loads(json.dumps(read_plots(LAYOUT)))
    plots[0]["paths"][0]["value"] = value
    with rpud_sim.bag.open(bag) as reader, pytest.raises(BagError, match=value.split(".")[0]):
        draw(reader, plots)
