"""The page of a drill on an arm in a real browser: its numbers, its plots, its feed."""

import pytest
from browser.live_page import exact, opened, served, text_has
from drill_client import start_drill
from support import PATIENCE

from rpud_sim.ros.client import DrillClient

pytestmark = pytest.mark.extended

NAMESPACE = "/arm_page"
VALUES = {
    "feed_model": "arm",
    "rotation_model": "friction_drive",
    "strata": "sandstone",
    "initial_feed": "0.005",
}


@pytest.fixture(scope="module")
def drill():
    with start_drill(NAMESPACE, **VALUES) as running:
        yield running


@pytest.fixture(scope="module")
def server(drill):
    with served(NAMESPACE) as address:
        yield address


@pytest.fixture(scope="module")
def client(drill):
    with DrillClient(NAMESPACE, node_name="test_client", patience=PATIENCE) as found:
        yield found


def test_numbers_plots_and_feed_of_an_arm(server, client, page_of):
    page = opened(page_of, server, NAMESPACE)
    text_has(page, 'output[data-value="values.borehole.layer"]', "^sandstone$")
    page.until("!document.querySelector('form[data-action=feed]').hidden")
    page.until("[...document.querySelectorAll('[data-needs]')].every((each) => !each.hidden)")
    page.tab.fill("form[data-action=feed] input[name=rate]", "-0.001")
    page.tab.click("form[data-action=feed] button")
    text_has(page, '.outcome[data-of="feed"]', "done")
    assert client.status.commands_accepted >= 1
    page.until(
        "Math.abs(Number(document.querySelector('output[data-value=\"values.mount.rate\"]')"
        ".dataset.exact) + 0.001) < 1e-9"
    )
    # A plot out of sight is not filled.
    page.tab.locator("div[data-needs=mount] figure.plot").first.scroll_into_view_if_needed()
    page.until("window.Bokeh.documents[0].get_model_by_name('arm').get_column('y').length > 5")
    assert exact(page, "values.rotation.rate") > 0.0
    page.check()
