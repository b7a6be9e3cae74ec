"""Bag with faults, for all tests of proofs; they alter copies of it."""

import pytest
from inspection.verify.proof_bags import write_proof_bag


@pytest.fixture(scope="session")
def bag(tmp_path_factory):
    return write_proof_bag(tmp_path_factory.mktemp("proof") / "bag")
