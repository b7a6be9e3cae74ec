"""The page of a running drill in a real browser: what it shows, what it does, what it survives."""

import re
from urllib.parse import quote

import pytest
from browser.live_page import exact, is_exact, opened, served, text_has, text_is
from browser.pages import PHONE
from drill_client import start_drill
from support import PATIENCE, Process

from rpud_sim.ros.client import DrillClient

pytestmark = pytest.mark.extended

NAMESPACE = "/live_page"


@pytest.fixture(scope="module")
def drill():
    with start_drill(NAMESPACE, rock_model="specific_energy") as running:
        yield running


@pytest.fixture(scope="module")
def server(drill):
    with served(NAMESPACE) as address:
        yield address


@pytest.fixture(scope="module")
def client(drill):
    with DrillClient(NAMESPACE, node_name="test_client", patience=PATIENCE) as found:
        yield found


@pytest.fixture
def live(server, client, page_of):
    """Page of a drill that plays as at its start."""
    client.reset("all")
    client.play()
    return opened(page_of, server, NAMESPACE)


_MOVES = """() => new Promise((done) => {
  let seen = 0, frames = 0;
  new MutationObserver((all) => { seen += all.length; }).observe(
    document.getElementById('s-mass'), { attributes: true });
  const count = () => (frames += 1) > 30 ? done(seen) : requestAnimationFrame(count);
  count();
})"""


def test_numbers_on_the_page_are_those_on_the_topic(live, client):
    client.press(23.5)
    client.pause()
    client.step(0.25)
    client.take()
    status = client.status
    text_is(live, "#state", "paused")
    text_has(live, 'output[data-value="status.impacts"]', f"^{status.impacts}$")
    for path, value in {
        "status.weight_on_bit": 23.5,
        "status.drive_voltage": status.drive_voltage,
        "status.depth": status.depth,
        "status.deadlines_missed": status.deadlines_missed,
    }.items():
        if path == "status.drive_voltage":
            assert f"{value:g} V" in live.tab.inner_text("#drive")
        else:
            assert exact(live, path) == value, path
    text_is(live, 'output[data-value="status.weight_on_bit"]', "23.5 N")

    positions = client.listen("nodal_plane")
    impacts = client.listen("contact_force")
    client.step(0.2)
    client.until(lambda: positions and impacts)
    is_exact(live, "values.nodal_plane.position", positions[-1].position)
    is_exact(live, "impact.peak_force", impacts[-1].peak_force)


def test_section_and_plots_follow_the_drill(live):
    text_has(live, "#section-scale", "drawn [0-9]+ times its size")
    before = live.tab.get_attribute("#s-mass", "transform")
    live.until(f"document.getElementById('s-mass').getAttribute('transform') !== '{before}'")
    text_has(live, "#section-text", "free mass at")

    live.until("rpudLive.tables[0].rows.length > 20")
    live.until("Bokeh.documents[0].get_model_by_name('peak force').get_column('y').length > 20")
    live.until("rpudPlots.groups.get('live').range[1] >= rpudLive.state.time - 0.5")
    text_has(live, "#rate", "^[1-9]")
    assert live.tab.locator("#flow svg").count() == 1


def test_each_button_does_what_it_says(live, client):
    tab = live.tab

    def press(name):
        tab.get_by_role("button", name=name, exact=True).click()

    def status_shows(**fields):
        client.until(
            lambda: all(getattr(client.status, name) == value for name, value in fields.items())
        )

    tab.get_by_label("weight on bit [N]").fill("31")
    press("Press")
    status_shows(weight_on_bit=31.0)
    tab.get_by_label("voltage [V]").fill("80")
    press("Drive")
    status_shows(drive_voltage=80.0, drive_enabled=True)
    tab.get_by_label("drive on").uncheck()
    tab.get_by_label("voltage [V]").fill("")
    press("Drive")
    status_shows(drive_enabled=False)
    text_is(live, "#drive", "off")
    press("Retract")
    status_shows(regime="free")
    press("Engage")
    status_shows(regime="drilling")
    press("Pause")
    status_shows(state="paused")
    before = client.time
    tab.get_by_label("step [s]").fill("0.25")
    press("Step")
    client.until(lambda: client.time >= before + 0.25)
    press("Play")
    status_shows(state="running")
    text_has(live, ".outcome[data-of='pause play step']", "^play: done")
    tab.locator("#kinds").select_option("bias")
    tab.get_by_label("channel").select_option("reacting_force")
    tab.get_by_label("magnitude").fill("2.5")
    press("Inject")
    client.until(lambda: client.faults and client.faults[-1].active)
    fault = client.faults[-1]
    assert (fault.kind, fault.channel, fault.magnitude) == ("bias", "reacting_force", 2.5)
    text_has(live, "#faults", "bias.*reacting_force.*2.5.*lasts")
    press("Clear all")
    client.until(lambda: not client.faults[-1].active)
    live.until("!document.querySelector('#faults').textContent.includes('lasts')")
    press("Reset")
    status_shows(weight_on_bit=8.0)
    live.until("document.querySelector('#banner').textContent.includes('run ')")
    text_is(live, "#faults", "none")


def test_a_refused_command_shows_the_reason_and_a_jam_is_called_so(live):
    live.tab.get_by_label("weight on bit [N]").fill("-5")
    live.tab.get_by_role("button", name="Press").click()
    text_is(
        live,
        ".outcome[data-of=press]",
        "press force -5: refused: weight_on_bit = -5 N is outside its range [0, 1000] N",
    )
    text_has(live, "#outcomes", "outside its range")
    text_has(live, "#last-refusal", "outside its range")

    live.tab.locator("#kinds").select_option("free_mass_jammed")
    live.tab.get_by_role("button", name="Inject").click()
    text_has(live, "#banner", "jammed")
    text_is(live, "#rate", "0")
    live.tab.get_by_role("button", name="clear fault 1").click()
    live.until("!document.querySelector('#banner').textContent.includes('jammed')")


def test_a_reloaded_page_and_a_second_one_show_the_same_past(live, server, page_of):
    live.until("rpudLive.tables[0].rows.length > 30")
    live.tab.reload()
    live.until("window.rpudLive && rpudLive.tables[0].rows.length > 30")
    second = opened(page_of, server, NAMESPACE)
    second.until("rpudLive.tables[0].rows.length > 30")
    live.tab.get_by_label("weight on bit [N]").fill("17")
    live.tab.get_by_role("button", name="Press").click()
    text_is(second, 'output[data-value="status.weight_on_bit"]', "17 N")
    text_has(second, "#outcomes", "press force 17: done")

    live.tab.get_by_role("button", name="zoom in").click()
    live.until("document.getElementById('follow').getAttribute('aria-pressed') === 'false'")
    live.tab.get_by_role("button", name="follow").click()
    live.until("document.getElementById('follow').getAttribute('aria-pressed') === 'true'")


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (PHONE, "dark")])
def test_the_page_is_accessible_and_asks_nothing_of_other_machines(
    server, client, page_of, width, scheme
):
    client.play()
    page = opened(
        page_of, server, NAMESPACE, width=width, scheme=scheme, reduced_motion=width == PHONE
    )
    page.until("rpudLive.tables[0].rows.length > 20")
    text_has(page, "#section-text", "free mass at")
    if width == PHONE:
        assert page.tab.evaluate(_MOVES) <= 2  # a picture a second, not a film
    page.keep(f"live_{width}_{scheme}")
    page.check()


def test_the_list_leads_to_the_drill(client, server, page_of):
    page = page_of(f"{server}/")
    page.tab.get_by_role("link", name=NAMESPACE).click()
    page.until("Number(document.documentElement.dataset.frame) > 0")
    page.assert_quiet()


@pytest.mark.parametrize("namespace", ["<script>alert(1)</script>", "/a b", "/'\"><img src=x>"])
def test_a_hostile_namespace_stays_text(server, page_of, namespace):
    page = page_of(f"{server}/drill?namespace={quote(namespace)}")
    page.until("document.querySelector('.warning') !== null")
    assert page.tab.locator("script, img").count() == 0
    page.assert_quiet()


def test_the_server_comes_back_and_the_page_goes_on(drill, page_of):
    with served(NAMESPACE) as base:
        page = opened(page_of, base, NAMESPACE)
    text_has(page, "#banner", "has gone")
    port = re.search(r":(\d+)$", base)[1]
    with Process("rpud", "watch", "--port", port, "--namespace", NAMESPACE) as running:
        running.wait_for_line("http://")
        page.until("window.rpudLive && rpudLive.tables[0].rows.length > 0")
