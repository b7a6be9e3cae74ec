"""Fixtures of the command line."""

from functools import partial

import pytest
from support import called


@pytest.fixture
def rpud(capsys):
    """Call the command line in this process; give exit code, output and errors."""
    return partial(called, capsys)
