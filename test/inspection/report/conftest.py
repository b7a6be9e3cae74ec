"""A drilled bag with faults, for all tests of reports."""

import pytest
from inspection.report.read_page import DURATION, SCENARIO, Page, surveyed
from sample_bags import write_offline_bag

from rpud_sim.inspection.report.bag_report import write_report
from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario import read_scenario


@pytest.fixture(scope="session")
def drilled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "scenario.yaml").write_text(SCENARIO)
    scenario = read_scenario(folder / "scenario.yaml")
    write_offline_bag(folder / "bag", preset("drilling"), DURATION, scenario=scenario)
    return folder / "bag"


@pytest.fixture(scope="session")
def seen(drilled):
    return surveyed(drilled)


@pytest.fixture(scope="session")
def page(drilled):
    out = drilled.parent / "new" / "report.html"
    out.parent.mkdir()
    write_report(drilled, out)
    assert [path.name for path in out.parent.iterdir()] == ["report.html"]
    return Page(out.read_text(encoding="utf-8"))
