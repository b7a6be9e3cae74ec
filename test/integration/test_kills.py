"""A recording that is killed at any moment is recovered without a gap, as by `make kills`."""

import re
import sys

import pytest

pytestmark = pytest.mark.extended


@pytest.mark.parametrize("words", [("--count", "15"), ("--count", "2", "--live")], ids=str)
def test_what_is_killed_leaves_all_but_its_end(process, words):
    # How long a busy machine takes to write is not this test's business, but `make kills`'s.
    kills = process(sys.executable, "-m", "tools.kills", *words, "--max-loss", "0.1", "--any-loss")
    assert kills.wait() == 0, kills.output
    assert re.match(f"{words[1]} kills .* each recovered without a gap", kills.output)
