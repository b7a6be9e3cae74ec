"""Plots of a campaign: every margin at its run, failures apart, and durations."""

from pathlib import Path

import numpy as np
import pytest
from campaign_results import FAILURE, OPEN, flown

from rpud_sim.testing.campaign.campaign_file import read_campaign
from rpud_sim.testing.campaign.page import campaign_page
from rpud_sim.testing.campaign.run_plots import duration_plots, margin_plots, reaction_plots

EXAMPLE = Path(__file__).resolve().parents[3] / "config" / "campaign.yaml"


@pytest.fixture(scope="module")
def campaign():
    return read_campaign(EXAMPLE).repeated(2)


def layers_of(plot):
    return {layer.name: layer for layer in plot.layers}


def test_margins_stand_at_their_runs_and_failures_apart(campaign):
    broken = campaign.runs[4]
    results = flown(campaign, lambda run: {"judged": {"force": FAILURE}} if run is broken else {})
    plots = {plot.title: plot for plot in margin_plots(results)}
    assert set(plots) == {f"margin: {each.name}" for each in campaign.expectations}
    force = plots["margin: force"]
    layers = layers_of(force)
    assert layers["limit"].value == 0.0
    assert layers["failed"].x.tolist() == [5.0]
    assert layers["failed"].y.tolist() == [-1.5]
    places = np.arange(1.0, len(campaign.runs) + 1.0)
    assert layers["passed"].x.tolist() == [place for place in places if place != 5.0]
    assert force.alt == "Least: -1.5 N in run 5."
    assert force.y.unit == "N"
    assert "failed" not in layers_of(plots["margin: drive off"])


def test_what_no_run_decides_has_no_plot(campaign):
    results = flown(campaign, lambda run: {"judged": {"drive off": OPEN}})
    titles = {plot.title for plot in (*margin_plots(results), *reaction_plots(results))}
    assert "margin: drive off" not in titles
    assert "time to react: drive off" not in titles
    assert "time to react: force" in titles


def test_durations_are_those_of_the_runs(campaign):
    results = flown(campaign, lambda run: {"reached": 1.0 * run.number, "wall_time": 0.5})
    simulated, real = duration_plots(results)
    assert simulated.layers[0].y.tolist() == [run.number for run in campaign.runs]
    assert set(real.layers[0].y) == {0.5}


def test_the_page_names_failed_runs_and_their_seeds(campaign):
    broken = campaign.runs[4]
    page = campaign_page(
        flown(campaign, lambda run: {"judged": {"force": FAILURE}} if run is broken else {})
    )
    failed = page.partition("Runs that failed</caption>")[2].partition("</table>")[0]
    assert failed.count("<tr><td>") == 1
    assert f"<tr><td>5</td><td>{broken.scenario.name}</td>" in failed
    seeds = page.partition("Failures by seed</caption>")[2].partition("</table>")[0]
    seed = broken.setup.seed
    count = sum(run.setup.seed == seed for run in campaign.runs)
    row = f"<tr><td>{seed}</td><td>{count}</td><td>1</td><td>{broken.scenario.name}</td></tr>"
    assert row in seeds
    assert "Runs that failed" not in campaign_page(flown(campaign))
