"""Fixtures for every test. This module is imported before any test, and so before any rclpy."""

import os
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from importlib import import_module
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix
from hypothesis import settings
from support import FEW, LOOPBACK, MANY_EXAMPLES, Process

from rpud_sim.testing.processes import DomainClaim

# The shell that starts the tests changes nothing: a background job ignores SIGINT or SIGHUP, and a
# user may have a umask, a language, a proxy, or a home folder without write permission.
signal.signal(signal.SIGINT, signal.default_int_handler)
for _number in (signal.SIGHUP, signal.SIGTERM):
    signal.signal(_number, signal.SIG_DFL)
os.umask(0o022)
for _name in list(os.environ):
    if _name.startswith(("LC_", "RCUTILS_", "RPUD_TRACEBACK")) or _name.lower().endswith("_proxy"):
        del os.environ[_name]
for _name in ("COLUMNS", "LINES", "NO_COLOR", "FORCE_COLOR", "LANGUAGE", "PYTHONWARNINGS", "TZ"):
    os.environ.pop(_name, None)

# `ros2 run` finds our executables, a shell without env.bash does not: `colcon test` has no other.
_executables = os.path.join(get_package_prefix("rpud_sim"), "lib", "rpud_sim")
_claim = DomainClaim()
_log_folder = tempfile.TemporaryDirectory(prefix="rpud_sim_log_")
_home = tempfile.TemporaryDirectory(prefix="rpud_sim_home_")
os.environ.update(
    PATH=os.pathsep.join([_executables, os.environ["PATH"]]),
    ROS_DOMAIN_ID=str(_claim.domain),
    ROS_PYTHON_CHECK_FIELDS="1",  # without it a wrong type in a message field ends the process
    ROS_LOG_DIR=_log_folder.name,
    LANG="C.UTF-8",
    TERM="xterm",
    PYTHONUNBUFFERED="1",  # so that a line can be waited for
    MPLBACKEND="Agg",
    **LOOPBACK,
)
if not os.access(os.path.expanduser("~"), os.W_OK):
    os.environ["HOME"] = _home.name
os.environ.pop("ROS_LOCALHOST_ONLY", None)  # deprecated, and it would overrule the discovery range

# The first example compiles, which takes longer than any deadline. `make test` draws the same
# examples each time, so it never fails by chance. `make test-all` draws more, from a printed seed.
# Hypothesis would also draw the constants of all modules that this process has imported so far,
# which differs from run to run when several processes share the tests; Ubuntu's 6.98 has none.
with suppress(ImportError):
    providers = import_module("hypothesis.internal.conjecture.providers")
    providers.is_local_module_file = lambda _: False
settings.register_profile("few", deadline=None, derandomize=True, database=None, max_examples=FEW)
settings.register_profile("many", deadline=None, print_blob=True)
settings.load_profile("many" if MANY_EXAMPLES else "few")

LONG = 900.0  # that an extended test may take [s]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the longest test first, so that the others run beside it and none waits for it.

    Extended tests may compute for minutes, and beside busy loops for longer.
    """
    items.sort(key=lambda item: item.name != "test_every_command_runs_and_prints_what_is_shown")
    for item in items:
        if item.get_closest_marker("extended") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(LONG))


@pytest.fixture(scope="session")
def drill_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the bag of a drill of 0.2 s; tests alter copies of it."""
    from sample_bags import write_offline_bag

    from rpud_sim.simulation import preset

    path = tmp_path_factory.mktemp("drill") / "bag"
    write_offline_bag(path, preset("drilling"), 0.2, 0.4)
    return path


@pytest.fixture(autouse=True)
def time_sharing() -> Iterator[None]:
    """Fail a test that leaves this thread with a real-time priority: it has a processor to itself.

    Every later test of the process would have it, and beside it other tests would wait for seconds.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    yield
    after = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, *before)
    assert after == before


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

    `make test-all` installs these packages into a folder, which RPUD_OPTIONAL names.
    """
    folder = os.environ.get("RPUD_OPTIONAL", "")
    if not folder:
        pytest.skip("RPUD_OPTIONAL names no folder of optional.lock, as `make test-all` does")
    assert os.path.isdir(folder), folder
    monkeypatch.syspath_prepend(folder)
    path = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [folder, path])))
    return folder
