"""Recorded runs, for all tests of forks."""

import pytest
from inspection.forked_runs import SCENARIO, VALUES, Used
from sample_bags import write_offline_bag

from rpud_sim.simulation import preset


@pytest.fixture(scope="session", params=VALUES)
def used(request, tmp_path_factory):
    return Used(tmp_path_factory.mktemp("used") / "bag", VALUES[request.param])


@pytest.fixture(scope="session")
def plain(tmp_path_factory):
    path = tmp_path_factory.mktemp("plain") / "bag"
    write_offline_bag(path, preset("drilling"), 0.3, 0.2, SCENARIO, 11)
    return path
