"""Services of the simulation, on a host whose drill does what the test says."""

from types import SimpleNamespace

import pytest
import rclpy

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.drill.simulation_services import SimulationServices
from rpud_sim.ros.drill.time_control import TimeControl


@pytest.fixture
def node():
    rclpy.init()
    node = rclpy.create_node("drill_node")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def test_the_stamp_of_a_step_is_that_at_its_end_though_a_reset_follows_at_once(node):
    run = SimpleNamespace(origin=100 * SECOND, time=0)
    drilling = SimpleNamespace(
        run=run, time_control=TimeControl(), follows_clock=False, step=lambda until: until
    )

    def request(action):
        reached = action(drilling)
        run.origin = 0  # another client's reset, before this one has its answer
        return reached

    services = SimulationServices(node, SimpleNamespace(drilling=drilling, request=request))
    assert services.step_until(lambda drilling: SECOND) == 101 * SECOND
