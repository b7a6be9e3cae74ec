"""Fixtures of tests with drills in lockstep."""

import pytest

from rpud_sim.testing.drill_pool import DrillPool


@pytest.fixture(scope="module")
def pool():
    """Pool of drills, which end with the module."""
    pool = DrillPool()
    yield pool
    pool.close()
