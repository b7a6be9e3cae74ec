"""The layouts for Foxglove and PlotJuggler show what there is."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rpud_msgs.msg import WeightOnBit
from rpud_msgs.srv import ClearFault, InjectFault

from rpud_sim.ros.drill.publishers import DIAGNOSTICS
from rpud_sim.ros.types import message_class
from rpud_sim.simulation.faults import KINDS
from rpud_sim.simulation.topics import TOPICS

CONFIG = Path(__file__).resolve().parent.parent / "config"
FOXGLOVE = json.loads((CONFIG / "foxglove.json").read_text())
PANELS = FOXGLOVE["configById"]
PLOTJUGGLER = ElementTree.parse(CONFIG / "plotjuggler.xml").getroot()
SERVICES = {"/rpud/inject_fault": InjectFault, "/rpud/clear_fault": ClearFault}
PUBLISHED = {**TOPICS, "/diagnostics": DIAGNOSTICS}
NUMBERS = ("double", "boolean", "uint32", "uint64")


def panels(kind):
    return [panel for name, panel in PANELS.items() if name.startswith(f"{kind}!")]


def fill(message, values):
    """Fill a message as the type allows: it has such fields, of such types."""
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            assert hasattr(message, name)
            setattr(message, name, value)


def field_type(topic, field):
    """Give the type of a topic's field."""
    message = message_class(PUBLISHED[topic.removeprefix("/rpud/")].type)
    return message.get_fields_and_field_types()[field]


def test_foxglove_plots_numbers_that_are_published():
    series = [series["value"] for panel in panels("Plot") for series in panel["paths"]]
    assert len(series) > 5
    for value in series:
        assert field_type(*value.split(".")) in NUMBERS, value
    states = [series["value"] for panel in panels("StateTransitions") for series in panel["paths"]]
    for value in states:
        assert field_type(*value.split(".")) in (*NUMBERS, "string"), value


def test_foxglove_shows_topics_that_are_published():
    topics = [panel["topicPath"] for panel in panels("RawMessages")]
    topics += [panel["topicToRender"] for panel in panels("DiagnosticSummary")]
    assert topics
    assert {topic.removeprefix("/rpud/") for topic in topics} <= PUBLISHED.keys()


@pytest.mark.parametrize("panel", panels("Publish"), ids=lambda panel: panel["buttonText"])
def test_foxglove_publishes_commands(panel):
    assert panel["datatype"] == "rpud_msgs/WeightOnBit"
    message = WeightOnBit()
    fill(message, json.loads(panel["value"]))
    assert panel["topicName"] == "/rpud/command/weight_on_bit"
    assert str(int(message.force)) in panel["buttonText"]


@pytest.mark.parametrize("panel", panels("CallService"), ids=lambda panel: panel["buttonText"])
def test_foxglove_asks_what_the_drill_can_do(panel):
    request = SERVICES[panel["serviceName"]].Request()
    fill(request, json.loads(panel["requestPayload"]))
    if isinstance(request, InjectFault.Request):
        assert request.fault.kind in KINDS


def test_foxglove_arranges_every_panel_once():
    def arranged(item):
        if isinstance(item, str):
            return [item]
        assert item["direction"] in ("row", "column")
        assert 0 < item["splitPercentage"] < 100
        return arranged(item["first"]) + arranged(item["second"])

    assert sorted(arranged(FOXGLOVE["layout"])) == sorted(PANELS)


def test_plotjuggler_plots_numbers_of_topics_that_it_asks_for():
    [selected] = [item.get("value").split(";") for item in PLOTJUGGLER.iter("selected_topics")]
    curves = [curve.get("name").rsplit("/", 1) for curve in PLOTJUGGLER.iter("curve")]
    assert len(curves) > 5
    for topic, field in curves:
        assert field_type(topic, field) in NUMBERS, (topic, field)
    assert {topic for topic, _ in curves} == set(selected)
