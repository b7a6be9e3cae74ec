"""Recorded drill that the tests of this folder look at."""

import pytest
from recorded_bags import write_drill


@pytest.fixture(scope="session")
def drill_bag(tmp_path_factory):
    return write_drill(tmp_path_factory.mktemp("watched"))
