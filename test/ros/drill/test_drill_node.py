"""The drill's node in the process that made it."""

import pytest
from rclpy.parameter import Parameter

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill.drill_node import DrillNode
from rpud_sim.ros.drill.publishers import DrillPublishers


@pytest.fixture
def node(nodes):
    nodes.append(DrillNode())
    return nodes[0]


def test_a_scenario_that_is_missing_ends_the_start(node):
    missing = Parameter("scenario", value="/missing.yaml")
    with pytest.raises(ParameterError, match=r"^/missing\.yaml: No such file or directory$"):
        DrillNode(namespace="/another", parameter_overrides=[missing])


def test_a_clean_up_is_no_end_of_the_process_however_long_its_listeners_take(node, monkeypatch):
    finished = []
    wait = DrillPublishers.wait_for_subscribers

    def slowly(self, seconds):
        finished.append(node.loop.finished)  # what the executor asks meanwhile
        wait(self, seconds)

    monkeypatch.setattr(DrillPublishers, "wait_for_subscribers", slowly)
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
        with pytest.raises(RuntimeError, match="the drill cannot be started; the log says why"):
            drill.start()
        assert drill.count_publishers("status") == 0
        scenario.write_text("faults: []\n")
        drill.start()
        assert drill.count_publishers("status") == 1
        drill.stop()
    finally:
        drill.destroy_node()
