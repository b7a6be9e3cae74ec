"""The drill's node in the process that made it."""

import pytest
from rclpy.parameter import Parameter
from support import until

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill.drill_node import DrillNode
from rpud_sim.ros.endpoints import AcknowledgedPublishers


@pytest.fixture
def node(nodes):
    nodes.append(DrillNode())
    return nodes[0]


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("scenario", "/missing.yaml", r"^/missing\.yaml: No such file or directory$"),
        ("weight_on_bit", -1.0, "is outside its range"),
    ],
)
def test_what_cannot_be_used_ends_the_start_and_leaves_no_topic(node, name, value, reason):
    parameter = Parameter(name, value=value)
    with pytest.raises(ParameterError, match=reason):
        DrillNode(namespace="/another", parameter_overrides=[parameter])

    def left():
        names = [name for name, _ in node.get_topic_names_and_types()]
        return [name for name in names if name.startswith("/another")]

    until(lambda: not left())


def test_a_clean_up_is_no_end_of_the_process_however_long_its_listeners_take(node, monkeypatch):
    finished = []
    wait = AcknowledgedPublishers.wait

    def slowly(self, seconds):
        finished.append(node.loop.finished)  # what the executor asks meanwhile
        return wait(self, seconds)

    monkeypatch.setattr(AcknowledgedPublishers, "wait", slowly)
    node.start()
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert finished == [False]


def test_a_configuration_that_fails_leaves_no_publisher_behind(node, tmp_path):
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("faults: []\n")
    parameter = Parameter("scenario", value=str(scenario))
    drill = DrillNode(namespace="/another", parameter_overrides=[parameter])
    try:
        scenario.unlink()
        with pytest.raises(RuntimeError, match="the drill cannot be started; see its log"):
            drill.start()
        assert drill.count_publishers("status") == 0
        scenario.write_text("faults: []\n")
        drill.start()
        assert drill.count_publishers("status") == 1
        drill.stop()
    finally:
        drill.destroy_node()


@pytest.mark.parametrize(
    ("value", "set_to"),
    [(7, 7), (7.0, 7), ("7", 7), (7.5, "seed = 7.5 is not a whole number"), (-2.0, "its range")],
)
def test_a_whole_number_is_an_integer_and_a_number_without_a_fraction_is_one(nodes, value, set_to):
    nodes.append(DrillNode())
    result = nodes[-1]._set_together([Parameter("seed", value=value).to_parameter_msg()])
    assert result.successful == isinstance(set_to, int)
    if result.successful:
        assert repr(nodes[-1].get_parameter("seed").value) == repr(set_to)
    else:
        assert set_to in result.reason
