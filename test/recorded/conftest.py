"""Bags of runs, which tests fork, verify and alter copies of."""

import pytest
from forked_runs import ARM, FAULTS, PROVED_FAULTS, VALUES, Used
from sample_bags import write_offline_bag

from rpud_sim.recorded.offline_bag import write_offline_bag as write_plan
from rpud_sim.simulation import preset
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.plan import Beginning, Plan


@pytest.fixture(scope="session", params=VALUES)
def used(request, tmp_path_factory):
    return Used(tmp_path_factory.mktemp("used") / "bag", VALUES[request.param])


@pytest.fixture(scope="session")
def plain(tmp_path_factory):
    path = tmp_path_factory.mktemp("plain") / "bag"
    write_offline_bag(path, preset("drilling"), 0.3, 0.2, FAULTS, 11)
    return path


@pytest.fixture(scope="session")
def bag(tmp_path_factory):
    """Bag of a drill with faults of the physics and of topics."""
    path = tmp_path_factory.mktemp("proof") / "bag"
    write_offline_bag(path, preset("drilling"), 0.33, 0.2, PROVED_FAULTS, 11)
    return path


@pytest.fixture(scope="session")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "bag"
    write_plan(path, Plan(Beginning(to_settings(ARM))), 0.5)
    return path
