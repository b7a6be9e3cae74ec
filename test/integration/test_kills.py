"""A recording that is killed at any moment is recovered without a gap, as by `make kills`."""

import re
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.extended


def test_killed_writers_leave_all_but_their_end(process):
    script = Path(__file__).parent.parent / "kills.py"
    # How long a busy machine takes to write is not this test's business, but `make kills`'s.
    kills = process(sys.executable, script, "--count", "15", "--max-loss", "0.1", "--any-loss")
    assert kills.wait() == 0, kills.output
    assert re.match("15 kills .* each recovered without a gap", kills.output)
