"""Campaigns in pytest: their files and runs as tests, their outcomes, and the pages of results.

pytest loads this module in every run, so it imports nothing heavy before it finds a campaign.
"""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from rpud_sim.foundation.atomic_folder import write_atomic
from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.terminal import printable
from rpud_sim.foundation.user_files import read_file
from rpud_sim.testing.errors import DrillError, ExpectationUndecidedError, LostMessagesError
from rpud_sim.testing.item_drills import give_back_drills, take_drill

if TYPE_CHECKING:
    from rpud_sim.testing.campaign_file import Campaign, CampaignRun
    from rpud_sim.testing.campaign_runs import CampaignResults, RecordedAttempt

NAME = "rpud_campaigns"  # of the plugin, by which its results are found
# Keys that together only campaigns have.
_KEYS = (rb"^system:", rb"^scenarios:", rb"^expectations:", rb"\banswers:")
_LONGEST = 100_000  # bytes that a campaign file may have


class CampaignFile(pytest.File):
    """Campaign file: an item for each run."""

    def collect(self) -> Iterator[CampaignItem]:
        from rpud_sim.testing.campaign_file import read_campaign

        try:
            campaign = read_campaign(self.path)
        except ParameterError as error:
            raise self.CollectError(str(error)) from None
        for run in campaign.runs:
            yield CampaignItem.from_parent(self, name=run.name, run=run, campaign=campaign)


class CampaignItem(pytest.Item):
    """Run of a campaign."""

    def __init__(self, run: CampaignRun, campaign: Campaign, **options: Any) -> None:
        super().__init__(**options)
        self._run, self._campaign = run, campaign
        self.rpud_attempt: RecordedAttempt | None = None

    def runtest(self) -> None:
        """Run it; a failed verdict fails the test, an undecided one another run may decide."""
        from rpud_sim.testing.campaign_runs import BROKEN, recorded_attempt, run_once

        system = self._campaign.system
        self.rpud_attempt = None  # attempt of a run before, if this one repeats it
        try:
            drill = take_drill(self, self._run.setup, system.place)
            self.rpud_attempt = run_once(drill, self._run, system, self._campaign.expectations)
        except (DrillError, LostMessagesError, ParameterError) as error:
            self.rpud_attempt = recorded_attempt(self._run, BROKEN, 0.0, str(error))
            raise
        if failures := self.rpud_attempt.failures:
            raise AssertionError("\n".join(failures))

    def teardown(self) -> None:
        give_back_drills(self)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the reasons without a traceback into this package."""
        if isinstance(excinfo.value, AssertionError | DrillError | ParameterError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        return self.path, 0, self.name


class UndecidedItem(pytest.Item):
    """Requirement that no run of a campaign decides: an error of every reporter."""

    def __init__(self, reason: str, **options: Any) -> None:
        super().__init__(**options)
        self._reason = reason

    def setup(self) -> None:
        """Raise an error here: pytest calls it an error, and in ``call`` it would be a failure."""
        raise ExpectationUndecidedError(f"{self.name}: undecided: {self._reason}", ())

    def runtest(self) -> None:
        """Test nothing."""

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the reason without a traceback."""
        return str(excinfo.value)

    def reportinfo(self) -> tuple[Path, None, str]:
        return self.path, None, self.name


class CampaignSession:
    """Campaigns of a session of pytest."""

    def __init__(self, config: pytest.Config) -> None:
        self.results: dict[str, CampaignResults] = {}  # by the path of the campaign's page
        self._config = config
        self._runs: dict[str, dict[str, Any]] = {}  # what is reported of each, by its test's name

    def pytest_collect_file(self, file_path: Path, parent: pytest.Collector) -> CampaignFile | None:
        if file_path.suffix not in (".yaml", ".yml"):
            return None
        try:
            content = read_file(file_path, _LONGEST + 1)
        except OSError:
            return None
        if len(content) > _LONGEST or not all(re.search(key, content, re.M) for key in _KEYS):
            return None
        return CampaignFile.from_parent(parent, path=file_path)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, Any, None]:
        """Add the outcome of a run to its report, which may go to another process."""
        result = yield
        attempt = getattr(item, "rpud_attempt", None)
        if call.when == "call" and attempt is not None:
            run = {"file": str(item.path), "name": item.name, **attempt.to_dict()}
            result.get_result().rpud_run = run

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the outcome of a run, and the place of its artefacts."""
        run = getattr(report, "rpud_run", None)
        if run is not None:
            self._runs[report.nodeid] = {**run, "wall_time": report.duration}
        elif report.when == "teardown" and report.nodeid in self._runs:
            self._runs[report.nodeid].update(report.user_properties)

    @pytest.hookimpl(tryfirst=True)  # before the results of pytest are written
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Write the page and the results of each campaign of which a run was attempt."""
        if not self._runs or hasattr(self._config, "workerinput"):
            return
        from rpud_sim.testing.campaign_runs import campaign_page, results_from_reports

        folder = self._config.getoption("rpud_artefacts")
        place = Path(self._config.rootpath, folder)
        for file in dict.fromkeys(each["file"] for each in self._runs.values()):
            runs = {test: each for test, each in self._runs.items() if each["file"] == file}
            results = results_from_reports(Path(file), list(runs.values()), place)
            file_id = next(iter(runs)).partition("::")[0]
            name = re.sub(r"[^\w.=+-]+", "_", file_id.replace("/", "-"))
            page = (place / name).with_suffix(".html")
            self.results[str(page)] = results
            self._report_undecided(session, file_id, results)
            if folder:
                place.mkdir(parents=True, exist_ok=True)
                write_atomic(page, campaign_page(results))
                content = json_text(results.to_dict(), indent=2) + "\n"
                write_atomic(page.with_suffix(".json"), content)

    def _report_undecided(
        self, session: pytest.Session, file_id: str, results: CampaignResults
    ) -> None:
        """Report each requirement that no run decides as an error of an item of its own."""
        for name, reason in results.undecided.items():
            item = UndecidedItem.from_parent(
                session, name=name, nodeid=f"{file_id}::{name}", reason=reason
            )
            item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
            if session.exitstatus == pytest.ExitCode.OK:
                session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Print the matrix of requirements by faults of each campaign."""
        for page, results in self.results.items():
            terminalreporter.write_sep("=", f"campaign {printable(results.campaign.name)}")
            lines = [
                *results.lines(),
                *([page] if self._config.getoption("rpud_artefacts") else []),
            ]
            for line in lines:
                terminalreporter.write_line(printable(line))
