"""Bags with faults, and of a drill on an arm, for all tests of proofs; they alter copies."""

import pytest
from inspection.verify.proof_bags import ARM, write_proof_bag

from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.run import Beginning


@pytest.fixture(scope="session")
def bag(tmp_path_factory):
    return write_proof_bag(tmp_path_factory.mktemp("proof") / "bag")


@pytest.fixture(scope="session")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "bag"
    write_offline_bag(path, Beginning(to_settings(ARM)), 0.5)
    return path
