"""The page of a drill on an arm shows the walk of its bit, if the bit has walked."""

import pytest
from inspection.report.read_page import Page, surveyed
from sample_bags import SECOND, write_without_walk

import rpud_sim.bag
from rpud_sim.inspection.offline_bag import write_offline_bag
from rpud_sim.inspection.report.bag_report import render
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.run import Beginning
from rpud_sim.simulation.scenario import Scenario, ScheduledFault

VALUES = {"feed_model": "arm", "strata": "sandstone", "initial_feed": 0.005}
TOPICS = ("contact_force", "borehole")
PLOT = "walk of the bit [µm]"


def drilled_on_an_arm(path, onset):
    """Write the bag of 0.3 s in which a bit walks from a time on [ns]; return its path."""
    scenario = Scenario(0, (ScheduledFault(onset, None, Fault("bit_walk")),))
    write_offline_bag(path, Beginning(to_settings(VALUES), scenario=scenario), 0.3, topics=TOPICS)
    return path


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    return drilled_on_an_arm(tmp_path_factory.mktemp("walked") / "bag", SECOND // 10)


def test_the_walk_of_the_bit_has_a_plot_and_a_value_with_its_unit(walked):
    with rpud_sim.bag.open(walked) as bag:
        end = bag.arrays("/rpud/borehole")["side_offset"][-1]
    assert end > 1e-5
    page = Page(render(surveyed(walked)))
    value = f"walk of the bit {1e3 * end:.4g} mm from the intended place of the hole"
    assert value in page.text
    expected = f"Walk of the bit over 0.3 s: between 0 and {1e6 * end:.4g} µm"
    assert page.plots[PLOT].startswith(expected)


def test_a_bag_of_an_earlier_version_has_a_report_without_the_walk(walked, tmp_path):
    page = Page(render(surveyed(write_without_walk(tmp_path / "old", walked))))
    assert "depth of the hole [µm]" in page.plots
    assert "walk of the bit" not in page.text
    assert "Not in this report" not in page.text


def test_a_bit_that_stays_in_its_place_has_no_plot_of_its_walk(tmp_path):
    page = Page(render(surveyed(drilled_on_an_arm(tmp_path / "bag", SECOND))))
    assert "depth of the hole [µm]" in page.plots
    assert "walk of the bit" not in page.text
