"""The layouts for Foxglove and PlotJuggler show what there is."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rpud_msgs.msg import Feed, WeightOnBit
from rpud_msgs.srv import ClearFault, InjectFault

from rpud_sim.ros.drill.publishers import OF_NODE
from rpud_sim.ros.graph import message_class
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.topics import TOPICS

CONFIG = Path(__file__).resolve().parent.parent / "config"
FOXGLOVE = {
    name: json.loads((CONFIG / f"{name}.json").read_text()) for name in ("foxglove", "foxglove_arm")
}
PLOTJUGGLER = {
    name: ElementTree.parse(CONFIG / f"{name}.xml").getroot()
    for name in ("plotjuggler", "plotjuggler_arm")
}
COMMANDS = {
    "/rpud/command/weight_on_bit": ("rpud_msgs/WeightOnBit", WeightOnBit),
    "/rpud/command/feed": ("rpud_msgs/Feed", Feed),
}
SERVICES = {"/rpud/inject_fault": InjectFault, "/rpud/clear_fault": ClearFault}
PUBLISHED = {**TOPICS, **OF_NODE}
NUMBERS = ("double", "boolean", "uint32", "uint64")


every_foxglove = pytest.mark.parametrize("layout", FOXGLOVE)
every_plotjuggler = pytest.mark.parametrize("layout", PLOTJUGGLER)


def panels(layout, kind):
    found = FOXGLOVE[layout]["configById"]
    return [panel for name, panel in found.items() if name.startswith(f"{kind}!")]


def pushed(kind):
    """Give each button of a kind with its layout."""
    return [
        pytest.param(layout, panel, id=f"{layout}: {panel['buttonText']}")
        for layout in FOXGLOVE
        for panel in panels(layout, kind)
    ]


def shown(layout):
    """Give the topics that a layout shows."""
    if layout in PLOTJUGGLER:
        curves = [curve.get("name") for curve in PLOTJUGGLER[layout].iter("curve")]
        return {name.split("/")[2] for name in curves}
    plots = [*panels(layout, "Plot"), *panels(layout, "StateTransitions")]
    return {one["value"].split(".")[0].split("/")[2] for panel in plots for one in panel["paths"]}


@pytest.mark.parametrize("layout", ["foxglove", "plotjuggler"])
def test_topics_of_models_that_are_off_by_default_have_layouts_of_their_own(layout):
    of_models = {name for name, topic in TOPICS.items() if topic.models}
    assert not shown(layout) & of_models
    assert shown(f"{layout}_arm") == shown(layout) | of_models


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


@every_foxglove
def test_foxglove_plots_numbers_that_are_published(layout):
    series = [one["value"] for panel in panels(layout, "Plot") for one in panel["paths"]]
    assert len(series) > 5
    for value in series:
        assert field_type(*value.split(".")) in NUMBERS, value
    transitions = panels(layout, "StateTransitions")
    states = [one["value"] for panel in transitions for one in panel["paths"]]
    for value in states:
        assert field_type(*value.split(".")) in (*NUMBERS, "string"), value


@pytest.mark.parametrize(("layout", "panel"), pushed("Publish"))
def test_foxglove_publishes_commands(layout, panel):
    datatype, kind = COMMANDS[panel["topicName"]]
    assert panel["datatype"] == datatype
    message = kind()
    fill(message, json.loads(panel["value"]))
    if kind is Feed:
        assert message.mode == Feed.MODE_RATE
        assert f"{1e3 * message.rate:g} mm/s" in panel["buttonText"]
    else:
        assert str(int(message.force)) in panel["buttonText"]
    # With a feed a weight on bit is rejected, and the other way round.
    assert (kind is Feed) == layout.endswith("_arm")


@pytest.mark.parametrize(("layout", "panel"), pushed("CallService"))
def test_foxglove_asks_what_the_drill_can_do(layout, panel):
    request = SERVICES[panel["serviceName"]].Request()
    fill(request, json.loads(panel["requestPayload"]))
    if isinstance(request, InjectFault.Request):
        assert request.fault.kind in KINDS


@every_plotjuggler
def test_plotjuggler_plots_numbers_of_topics_that_it_asks_for(layout):
    content = PLOTJUGGLER[layout]
    [selected] = [item.get("value").split(";") for item in content.iter("selected_topics")]
    curves = [curve.get("name").rsplit("/", 1) for curve in content.iter("curve")]
    assert len(curves) > 5
    for topic, field in curves:
        assert field_type(topic, field) in NUMBERS, (topic, field)
    assert {topic for topic, _ in curves} == set(selected)
