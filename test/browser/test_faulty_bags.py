"""The screen of a bag with garbage, lost messages or wrong stamps, in a real browser."""

import pytest
from altered_bags import altered, numbered
from browser_screens import of_screen, text_has, text_is, until_screen
from recorded_bags import SECOND, ForceRecorder, header, rows_of
from sample_bags import write_offline_bag
from support import Process

from rpud_sim.bag import BagWriter, QosProfile, Topic
from rpud_sim.messages.columns import to_plain
from rpud_sim.messages.definitions import find_definition, find_type_hash, installed_codec
from rpud_sim.simulation import preset

pytestmark = pytest.mark.extended

CONTACT, FAULTS = "rpud_msgs/msg/ContactForce", "rpud_msgs/msg/Faults"


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    path = tmp_path_factory.mktemp("faulty") / "healthy"
    write_offline_bag(path, preset("drilling"), 6.0)
    return path


@pytest.fixture
def opened(page_of):
    servers = []

    def open_bag(path):
        servers.append(server := Process("rpud", "watch", path, "--port", "0"))
        page = page_of(server.__enter__().wait_for_line(r"bag .*: (http://\S+)")[1])
        until_screen(page, "screen.seen.read === 1 && screen.seen.view && screen.seen.numbers")
        return page

    yield open_bag
    for server in servers:
        server.__exit__(None, None, None)


def test_one_garbage_impact_leaves_the_band_of_all_others(healthy, tmp_path, opened):
    codec = installed_codec(CONTACT)

    def spoil(message):
        fields = to_plain(codec.decode(message.data))
        return [codec.encode({**fields, "peak_force": 5.622377492818663e174})]

    page = opened(altered(healthy, tmp_path / "bag", numbered("contact_force", 700, spoil)))
    layer = "screen.seen.view.layers.peak_force"
    lows, highs = of_screen(page, f"[{layer}.low, {layer}.high].map((each) => Array.from(each))")
    assert min(lows) > 10.0
    assert max(highs) < 10e3
    assert of_screen(page, f"{layer}.outliers.v.length + {layer}.outliers.more") < 200
    assert of_screen(page, f"{layer}.garbage.count") == 1
    time = of_screen(page, f"{layer}.garbage.t[0]")
    of_screen(page, f"screen.playhead.seek({time} + 0.3)")
    text_has(page, "#numbers", "1 garbage")
    text_has(page, "[data-number=peak_force]", r"^\d\.\d+$")  # of all others


def test_lost_messages_are_not_shown_as_no_impacts(healthy, tmp_path, opened):
    start = None

    def lose(message):
        nonlocal start
        start = message.log_time if start is None else start
        lost = 2 * SECOND < message.log_time - start < 4.5 * SECOND
        return [] if lost and message.topic == "/rpud/contact_force" else [message.data]

    page = opened(altered(healthy, tmp_path / "bag", lose))
    holes = of_screen(page, "screen.seen.view.layers.peak_force.holes")
    assert holes[0][0] <= 2.1
    assert holes[-1][1] >= 3.9
    assert of_screen(page, "screen.seen.view.layers.reacting_force.holes") is None
    of_screen(page, "screen.playhead.seek(3.9)")
    text_is(page, "#doing", "messages lost")
    text_is(page, "[data-number=peak_force]", "\N{EN DASH}")
    page.until("Number(document.querySelector('[data-number=impact_rate]').textContent) > 100")
    of_screen(page, "screen.playhead.seek(1.9)")
    page.until("document.querySelector('#doing').textContent !== 'messages lost'")


def test_one_wrong_stamp_sets_no_length_and_no_drill_is_drawn(tmp_path, opened):
    recorder = ForceRecorder(tmp_path / "bag")
    rows = rows_of(300)
    rows[150] = (rows[150][0], 351_608_008 * SECOND, 1.0)
    recorder.write(rows, "/sensor/force")
    recorder.close()
    page = opened(tmp_path / "bag")
    assert of_screen(page, "screen.extent")[1] == pytest.approx(2.99, abs=0.1)
    text_has(page, "#banner", "1 of /sensor/force")
    assert not page.tab.locator("#section").is_visible()


def test_first_messages_of_a_drill_are_no_complaint(tmp_path, opened):
    """A latched message is older than the bag that begins with it."""
    codec, path = installed_codec(FAULTS), tmp_path / "bag"
    force = installed_codec("rpud_msgs/msg/ReactingForce")
    with BagWriter(path) as bag:
        for name, kind in (("faults", FAULTS), ("reacting_force", force.type)):
            offer = QosProfile(durability="transient_local" if kind == FAULTS else "volatile")
            topic = Topic(f"/rpud/{name}", kind, find_type_hash(kind), (offer,))
            bag.add_topic(topic, find_definition(kind))
        none = {"header": header(5 * SECOND), "faults": [], "forgotten": 0}
        bag.write("/rpud/faults", codec.encode(none), 0, 0)
        for log, stamp, value in rows_of(300, stamp=100 * SECOND):
            fields = {"header": header(stamp), "force": value, "impacts": 0}
            bag.write("/rpud/reacting_force", force.encode(fields), log, log)
    page = opened(path)
    assert of_screen(page, "screen.extent")[1] == pytest.approx(2.99, abs=0.1)
    assert "Stamps outside" not in page.tab.text_content("#banner")
