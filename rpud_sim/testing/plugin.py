"""Plugin of pytest: drills in lockstep, what a failing test leaves behind, and campaigns.

Fixtures: ``drill``, ``drill_factory``, ``recording``. Mark: ``rpud``. Options:
``--rpud-artefacts DIR``, ``--rpud-keep``, ``--rpud-shake N``, ``--rpud-shake-seed S``. pytest loads
this module in every run, so it imports nothing heavy before a fixture or the mark is used.
"""

from __future__ import annotations

import argparse
import secrets
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import pytest

from rpud_sim.foundation.quantities import ExpectedError
from rpud_sim.testing.campaign_session import NAME, CampaignSession
from rpud_sim.testing.errors import ExpectationUndecidedError
from rpud_sim.testing.item_drills import (
    ATTEMPT,
    DRILLS,
    POOL,
    give_back_drills,
    pool_of,
    take_drill,
)

if TYPE_CHECKING:
    from rpud_sim.testing.drill import LockstepDrill
    from rpud_sim.testing.recording import Recording

_MARK = (
    "rpud(config=FILE, faults=FILE_OR_LIST, seed=N, namespace=NAME, **parameters): drill of the "
    "test: a ROS parameter file, faults that begin by themselves, a seed, and parameters by name."
)

_UNOBSERVED = (
    "this test has a drill and no expectation: it passes whatever the drill does. Call "
    "drill.expect or drill.step_until, or look at drill.status or drill.messages"
)

_SEED = "rpud_shake_seed"
_ERROR = pytest.StashKey[str]()  # in the mark of an item
_PROPERTIES = pytest.StashKey[list[tuple[str, object]]]()  # of an item, by this plugin
_PAGES = pytest.StashKey[Executor]()  # that writes report pages, one at a time


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("rpud_sim", "tests with a drill in lockstep")
    group.addoption(
        "--rpud-artefacts",
        metavar="DIR",
        default="rpud-artefacts",
        help="folder for the bag, the report, commands, output and versions of each failing test "
        "with a drill; empty for none (default: %(default)s)",
    )
    group.addoption(
        "--rpud-keep",
        action="store_true",
        help="leave the same of each passing test with a drill",
    )
    group.addoption(
        "--rpud-shake",
        metavar="N",
        type=_count,
        default=0,
        help="run each passing test with a drill N times more, stop the processes under test for "
        "some milliseconds, change the order among topics, and fail if anything differs",
    )
    group.addoption(
        "--rpud-shake-seed",
        metavar="S",
        type=_count,
        help="seed of what --rpud-shake does (default: drawn and printed)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Declare the mark, ignore a warning of ROS's own Python, and let campaigns be collected."""
    config.addinivalue_line("markers", _MARK)
    # pytest rewrites the assertions of whatever has a plugin: of all of this package, again at each
    # start where Python keeps no bytecode, which takes a second.
    getattr(config.pluginmanager.rewrite_hook, "_must_rewrite", set()).discard("rpud_sim")
    config.addinivalue_line("filterwarnings", "ignore:module 'sre_:DeprecationWarning:lark")
    config.pluginmanager.register(CampaignSession(config), NAME)
    if config.option.rpud_shake and getattr(config.option, "reruns", 0):
        raise pytest.UsageError(
            "--reruns has no effect with --rpud-shake, which finds tests that do not repeat: give "
            "one of them"
        )
    if config.option.rpud_shake_seed is None:
        given = getattr(config, "workerinput", {})  # of a worker of xdist
        config.option.rpud_shake_seed = given.get(_SEED, secrets.randbelow(1_000_000))


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Give a worker of xdist the seed, as all of them draw from one."""
    node.workerinput[_SEED] = node.config.option.rpud_shake_seed


def pytest_report_header(config: pytest.Config) -> list[str]:
    """Return how often tests are shaken, and the seed."""
    count, seed = config.option.rpud_shake, config.option.rpud_shake_seed
    return [f"rpud_sim: {count} shaken runs of each test with a drill, seed {seed}"][: count > 0]


def pytest_collection_finish(session: pytest.Session) -> None:
    """Check the marks of all selected tests; where the first has a drill, its process starts."""
    if not session.config.option.collectonly and any(map(_has_drill, session.items[:1])):
        with suppress(RuntimeError):  # no domain is free, which the test will report
            pool_of(session.config)
    errors = []
    for item in session.items:
        if item.get_closest_marker("rpud") is None:
            continue
        from rpud_sim.foundation.quantities import ParameterError

        try:
            _setup_of(item)
        except ParameterError as error:
            item.stash[_ERROR] = f"mark rpud: {error}"
            errors.append(f"{item.nodeid}: mark rpud: {error}")
    # A worker of xdist could not report it: there the test itself fails, before its drill starts.
    if errors and not hasattr(session.config, "workerinput"):
        raise pytest.UsageError(*errors)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Forget the properties of an earlier run of the item, which has failed and is repeated."""
    own = item.stash.setdefault(_PROPERTIES, [])
    item.user_properties[:] = [each for each in item.user_properties if each not in own]
    own.clear()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Warn of a test that has passed, and whose drills might have done anything.

    A shaken test that differs from its first run fails.
    """
    attempt = item.stash.get(ATTEMPT, None)
    try:
        result = yield
    finally:
        drills = item.stash.get(DRILLS, [])
        if attempt is not None:
            attempt.finish(drills)
    if attempt is not None:
        attempt.fail()
    if drills and not any(drill.observed for drill in drills):
        item.warn(pytest.PytestWarning(_UNOBSERVED))
    return result


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a test with its shaken runs, if these are requested."""
    option = item.config.option
    if not option.rpud_shake or option.setuponly:
        return None
    from rpud_sim.testing.shake import shake

    if item.get_closest_marker("flaky") is not None:
        item.warn(pytest.PytestWarning("the mark flaky has no effect with --rpud-shake"))
    shake(item, nextitem, option.rpud_shake, option.rpud_shake_seed)
    return True


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, Any, None]:
    """Leave the artefacts of a test whose drill still is as it was when the test failed."""
    outcome = yield
    report = outcome.get_result()
    drills = item.stash.get(DRILLS, [])
    if not drills:
        return
    properties: list[tuple[str, object]] = []
    if call.when == "call":
        properties += [("rpud_verdict", text) for drill in drills for text in drill.verdict_lines]
    keep = item.config.getoption("rpud_keep") and call.when == "call"
    name = item.config.getoption("rpud_artefacts")
    if not name or not (report.failed or keep):
        _add_properties(item, properties)
        return
    from rpud_sim.testing.artefacts import save_artefacts

    if _PAGES not in item.config.stash:
        item.config.stash[_PAGES] = ThreadPoolExecutor(1, "rpud_report")
    pages = item.config.stash[_PAGES]
    folder = Path(item.config.rootpath, name)
    text, places = save_artefacts(folder, item.nodeid, drills, pages, report.longreprtext)
    _add_properties(item, [*properties, *places])
    if hasattr(report.longrepr, "addsection"):
        report.longrepr.addsection("rpud_sim", text)
    else:
        report.sections.append(("rpud_sim", text))


@pytest.hookimpl(specname="pytest_runtest_makereport", wrapper=True, trylast=True)
def pytest_report_of_an_expected_error(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Show an error of this package where the test caused it; an undecided test is an error.

    pytest calls a failed report an error in any phase but ``call``. Reporters know only pytest's
    phases, and at most one ``teardown`` of a test.
    """
    error = call.excinfo
    if error and error.errisinstance(ExpectedError) and not item.config.getoption("fulltrace"):
        _end_at_caller(error.tb)
    report = yield
    if call.when == "call" and error and error.errisinstance(ExpectationUndecidedError):
        report.when = "setup"
    return report


def _end_at_caller(trace: TracebackType | None) -> None:
    """Cut the frames of this package off the end of a traceback, and of dataclasses."""
    caller, package = None, ""
    while trace:
        # Not the file: bytecode that pytest keeps has the path of its first import.
        name = trace.tb_frame.f_globals.get("__name__", "").partition(".")[0]
        if name != "rpud_sim":
            caller, package = trace, name
        trace = trace.tb_next
    # pytest calls a fixture: its frames do not help.
    if caller and package not in ("_pytest", "pluggy"):
        caller.tb_next = None


@pytest.hookimpl(trylast=True)  # after the teardown of a test that was interrupted
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Have the drills end, while pytest prints its summary, and wait for the report pages."""
    pool = session.config.stash.get(POOL, None)
    if pool is not None:
        pool.interrupt()
    if _PAGES in session.config.stash:
        session.config.stash[_PAGES].shutdown()


def pytest_unconfigure(config: pytest.Config) -> None:
    """Wait until the drills have ended."""
    pool = config.stash.get(POOL, None)
    if pool is not None:
        pool.close()


@pytest.fixture
def drill_factory(request: pytest.FixtureRequest) -> Iterator[Callable[..., LockstepDrill]]:
    """Start further drills: ``drill_factory(weight_on_bit=20.0)``, with the options of the mark.

    Each has a ROS domain of its own. The options of the test's own mark hold where they are not
    given.
    """
    item = request.node
    if _ERROR in item.stash:
        pytest.fail(item.stash[_ERROR], pytrace=False)
    pool_of(item.config)

    def make(**options: Any) -> LockstepDrill:
        return take_drill(item, _setup_of(item, options), item.path.parent)

    yield make
    give_back_drills(item)


@pytest.fixture
def drill(drill_factory: Callable[..., LockstepDrill]) -> LockstepDrill:
    """Drill in lockstep, at time zero, as the mark ``rpud`` describes it; see ``LockstepDrill``."""
    return drill_factory()


@pytest.fixture
def recording(drill: LockstepDrill, tmp_path: Path) -> Iterator[Recording]:
    """Record the test with the recorder; ``recording.stop()`` returns the path of the bag."""
    from rpud_sim.testing.recording import Recording

    record = Recording(drill, tmp_path / "recording")
    yield record
    record.stop()


def _add_properties(item: pytest.Item, properties: list[tuple[str, object]]) -> None:
    item.user_properties += properties
    item.stash[_PROPERTIES] += properties


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 on")
    return int(text)


def _has_drill(item: pytest.Item) -> bool:
    return "drill_factory" in getattr(item, "fixturenames", ())


def _setup_of(item: pytest.Item, further: dict[str, Any] | None = None) -> Any:
    from rpud_sim.foundation.quantities import ParameterError
    from rpud_sim.testing.setup import drill_setup

    options: dict[str, Any] = {}
    for mark in reversed(list(item.iter_markers("rpud"))):  # the closest one holds
        if mark.args:
            raise ParameterError(
                f"{mark.args[0]!r} has no name: write rpud(config=..., faults=..., seed=...)"
            )
        options.update(mark.kwargs)
    return drill_setup({**options, **(further or {})}, (item.path.parent, item.config.rootpath))
