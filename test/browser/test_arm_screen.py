"""The screen of a drill on an arm in a real browser: its feed, its plots, its hole."""

import pytest
from browser_screens import opened, served, text_has, text_is, until_screen
from drill_client import start_drill
from support import PATIENCE

from rpud_sim.ros.client import DrillClient

pytestmark = pytest.mark.extended

NAMESPACE = "/arm_screen"
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


def test_feed_plots_and_hole_of_an_arm(drill, page_of):
    with (
        DrillClient(NAMESPACE, node_name="test_client", patience=PATIENCE) as client,
        served(NAMESPACE) as server,
    ):
        page = opened(page_of, server, NAMESPACE)
        page.until("!document.querySelector('#feed').hidden")
        page.tab.fill("#rate", "-1")
        page.tab.locator("#feed").get_by_role("button", name="Apply").click()
        client.until(lambda: client.status.feed_rate == pytest.approx(-1e-3))
        until_screen(page, "screen.seen.hole?.layers[0].name === 'sandstone'")
        text_has(page, "#section", "sandstone")
        for title in ("torque", "feed and mount", "force of the arm on the mount"):
            page.tab.locator("[data-plot=more] select").select_option(label=title)
            quantity = "screen.plots.plots.at(-1).choice.layers[0].quantity"
            until_screen(page, f"screen.seen.view.layers[{quantity}]?.t.length > 5")
        page.keep("arm", whole=False)
        page.check()


def test_above_the_rock_it_does_not_drill_and_lost_commands_are_an_alarm(page_of):
    """As config/arm.yaml: 5 mm above the rock, and off half a second after the last command."""
    namespace = "/arm_above"
    values = VALUES | {"initial_feed": "-0.005", "drive_enabled": "false", "command_timeout": "1.5"}
    with start_drill(namespace, **values), served(namespace) as server:
        page = opened(page_of, server, namespace)
        text_is(page, "#doing", "commands lost")
        page.tab.click("#on")
        text_is(page, "#doing", "no contact")
        text_is(page, "#place", "not in the rock")
        assert page.tab.is_visible("#section .air")
        text_is(page, "#doing", "commands lost")
        text_has(page, "#why", "none came for 1.5 s")
        text_has(page, "#alarms", "commands lost")
        until_screen(page, "screen.seen.log.at(-1).text.startsWith('commands lost')")
        page.tab.click("#pauses")
        page.tab.fill("[name=seconds]", "60")
        page.tab.locator("[data-of~=step] form button").click()
        text_is(page, "#doing", "stepping")
        text_has(page, "#why", r"^\d+ of 60 s$")
        page.tab.click("#pauses")
        text_is(page, "#doing", "paused")
        page.assert_quiet()
