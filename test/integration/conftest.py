"""Fixtures of a drill in a process of its own, and of its clients."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import drill_client
import pytest
from drill_client import Client
from support import Process


def start_drills() -> Iterator[Callable[..., Process]]:
    """Start drills, as in `start_drill("/rpud", seed=3)`; the end of the scope stops them.

    It returns when the drill has printed `ready`, a regular expression.
    """
    with ExitStack() as stack:

        def start(namespace: str, ready: str = "drilling: regime", **parameters) -> Process:
            process = stack.enter_context(drill_client.start_drill(namespace, **parameters))
            process.wait_for_line(ready)
            return process

        yield start


start_drill = pytest.fixture(start_drills, name="start_drill")
start_module_drill = pytest.fixture(start_drills, name="start_module_drill", scope="module")


@pytest.fixture
def connect() -> Iterator[Callable[[str], Client]]:
    """Connect clients, as in `connect("/rpud")`; the end of the test closes them."""
    with ExitStack() as stack:
        yield lambda namespace: stack.enter_context(Client(namespace))
