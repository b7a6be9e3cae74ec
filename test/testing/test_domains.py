import os
import socket
import subprocess
import sys

import pytest

from rpud_sim.testing import processes
from rpud_sim.testing.processes import DomainClaim

CLAIM = "from rpud_sim.testing.processes import DomainClaim; print(DomainClaim().domain)"


@pytest.fixture
def claims():
    made = []

    def claim():
        made.append(DomainClaim())
        return made[-1].domain

    yield claim
    for each in made:
        each.release()


def test_a_claimed_domain_is_exclusive_whatever_the_temporary_folder(claims, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    domains = {claims() for _ in range(3)}
    assert len(domains) == 3
    (other_folder := tmp_path / "other").mkdir()
    environment = {**os.environ, "TMPDIR": str(other_folder)}
    other = subprocess.check_output([sys.executable, "-c", CLAIM], env=environment, text=True)
    assert int(other) not in domains
    assert int(os.environ["ROS_DOMAIN_ID"]) not in domains  # that of this run of tests
    assert not domains & {0, 42}


@pytest.fixture
def apart(monkeypatch):
    """Claim where nobody else does: other test runs take the highest free domain at any time."""
    monkeypatch.setattr(processes, "_LAST_DOMAIN", 44 + os.getpid() % 40)


def test_a_released_domain_is_free_again(claims, apart):
    claim = DomainClaim()
    claim.release()
    assert claims() == claim.domain


def test_a_domain_in_use_without_a_lock_is_skipped(claims, apart):
    free = DomainClaim()
    free.release()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("127.0.0.1", 7400 + 250 * free.domain + 12))
        assert claims() != free.domain
