"""Fixtures for every test. This module is imported before any test, and so before any rclpy."""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
from ament_index_python.packages import get_package_prefix
from hypothesis import settings
from support import LOOPBACK, Process, claim_ros_domain

# `ros2 run` finds our executables, a shell without env.bash does not: `colcon test` has no other.
_executables = os.path.join(get_package_prefix("rpud_sim"), "lib", "rpud_sim")
_domain, _domain_lock = claim_ros_domain()
_log_folder = tempfile.TemporaryDirectory(prefix="rpud_sim_log_")
os.environ.update(
    PATH=os.pathsep.join([_executables, os.environ["PATH"]]),
    ROS_DOMAIN_ID=str(_domain),
    ROS_PYTHON_CHECK_FIELDS="1",  # without it a wrong type in a message field ends the process
    ROS_LOG_DIR=_log_folder.name,
    PYTHONUNBUFFERED="1",  # so that a line can be waited for
    MPLBACKEND="Agg",
    **LOOPBACK,
)
os.environ.pop("ROS_LOCALHOST_ONLY", None)  # deprecated, and it would overrule the discovery range

# The first example compiles, which takes longer than any deadline. CI must not fail by chance.
_same = "CI" in os.environ or os.environ.get("RPUD_EXAMPLES") == "same"
settings.register_profile("rpud_sim", deadline=None, derandomize=_same)
settings.load_profile("rpud_sim")


@pytest.fixture
def process() -> Iterator[Callable[..., Process]]:
    """Start real processes, as in `process("rpud", "run")`; the end of the test stops them."""
    with ExitStack() as stack:

        def start(*command: str | os.PathLike, **options) -> Process:
            return stack.enter_context(Process(*command, **options))

        yield start


@pytest.fixture
def optional_packages(monkeypatch: pytest.MonkeyPatch) -> str:
    """Let this process and those that it starts import what users may install in addition.

    `make test` installs these packages into a folder of their own and names it in RPUD_OPTIONAL.
    """
    folder = os.environ.get("RPUD_OPTIONAL", "")
    if not folder:
        pytest.skip("RPUD_OPTIONAL names no folder with optional.lock installed; `make test` does")
    assert os.path.isdir(folder), folder
    monkeypatch.syspath_prepend(folder)
    path = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [folder, path])))
    return folder
