"""Plugin of pytest for campaigns: collects their files, gathers outcomes, writes their pages.

pytest loads this module in every run, so it imports nothing heavy before it finds a campaign.
"""

from __future__ import annotations

import json
import re
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from rpud_sim.foundation.whole_folder import whole_file

if TYPE_CHECKING:
    from rpud_sim.testing.campaign_results import CampaignResults

_SUFFIXES = (".yaml", ".yml")
NAME = "rpud_campaigns"  # of the plugin, by which its results are found

# Keys that together only campaigns have.
_KEYS = (
    *(re.compile(rb"^%b:" % key, re.M) for key in (b"system", b"scenarios", b"expectations")),
    re.compile(rb"\banswers:"),
)
_LONGEST = 100_000  # bytes that a campaign file may have
_UNSAFE = re.compile(r"[^\w.=+-]+")


class CampaignSession:
    """Campaigns of a session of pytest."""

    def __init__(self, config: pytest.Config) -> None:
        self.results: dict[str, CampaignResults] = {}  # by the path of the campaign's page
        self._config = config
        self._reports: dict[str, dict[str, Any]] = {}  # of each run, by the name of its test

    def pytest_collect_file(
        self, file_path: Path, parent: pytest.Collector
    ) -> pytest.Collector | None:
        if file_path.suffix not in _SUFFIXES or not _is_campaign(file_path):
            return None
        from rpud_sim.testing.campaign_runs import CampaignFile

        return CampaignFile.from_parent(parent, path=file_path)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, Any, None]:
        """Add the outcome of a run to its report, which may come from another process."""
        result = yield
        outcome = getattr(item, "rpud_outcome", None)
        if call.when == "call" and outcome is not None:
            result.get_result().rpud_run = {
                "file": str(item.path),
                "name": item.name,
                "outcome": outcome.to_json(),
            }

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the outcome of a run, and the place of its artefacts."""
        run = getattr(report, "rpud_run", None)
        if run is not None:
            self._reports[report.nodeid] = {**run, "wall_time": report.duration}
        elif report.when == "teardown" and report.nodeid in self._reports:
            self._reports[report.nodeid].update(report.user_properties)

    @pytest.hookimpl(tryfirst=True)  # before the results of pytest are written
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Write the page and the results of each campaign of which a run was flown."""
        if not self._reports or hasattr(self._config, "workerinput"):
            return
        from rpud_sim.testing.campaign_results import campaign_page, results_from_reports

        folder = self._config.getoption("rpud_artefacts")
        for file in dict.fromkeys(each["file"] for each in self._reports.values()):
            reports = {test: each for test, each in self._reports.items() if each["file"] == file}
            place = Path(self._config.rootpath, folder)
            results = results_from_reports(Path(file), reports.values(), place)
            file_id = next(iter(reports)).partition("::")[0]
            name = file_id.replace("/", "-")
            page = place / _UNSAFE.sub("_", Path(name).with_suffix(".html").name)
            self.results[str(page)] = results
            self._report_undecided(session, file_id, results)
            if folder:
                place.mkdir(parents=True, exist_ok=True)
                _write(page, campaign_page(results))
                content = json.dumps(results.to_dict(), indent=2)
                _write(page.with_suffix(".json"), content + "\n")

    def _report_undecided(
        self, session: pytest.Session, file_id: str, results: CampaignResults
    ) -> None:
        """Report each requirement that no run decides as an error of an item of its own."""
        for name, reason in results.undecided.items():
            report = pytest.TestReport(
                nodeid=f"{file_id}::{name}",
                location=(file_id, None, name),
                keywords={},
                outcome="failed",
                longrepr=f"{name}: undecided: {reason}",
                when="setup",  # what pytest calls an error, and not a failure
            )
            self._config.hook.pytest_runtest_logreport(report=report)
            if session.exitstatus == pytest.ExitCode.OK:
                session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Print the matrix of requirements by faults of each campaign."""
        from rpud_sim.foundation.terminal import printable

        for page, results in self.results.items():
            terminalreporter.write_sep("=", f"campaign {printable(results.campaign.name)}")
            for line in results.lines():
                terminalreporter.write_line(printable(line))
            if self._config.getoption("rpud_artefacts"):
                terminalreporter.write_line(printable(page))


def _is_campaign(file: Path) -> bool:
    try:
        with file.open("rb") as stream:
            content = stream.read(_LONGEST + 1)
    except OSError:
        return False
    return len(content) <= _LONGEST and all(key.search(content) for key in _KEYS)


def _write(file: Path, text: str) -> None:
    with whole_file(file) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
