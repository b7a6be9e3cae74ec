"""The screen in a real browser, of frames that a test writes one by one."""

from collections import deque

import numpy as np
import pytest
from browser_screens import of_screen, until_screen
from screen_client import serving
from support import until

from rpud_sim.viewer.frames import Store
from rpud_sim.viewer.history import MOTION

pytestmark = pytest.mark.extended


class Scripted(Store):
    """Running drill whose next frames are in ``frames``."""

    mode = "live"

    def __init__(self):
        self.frames, self.client = deque(), None

    def frame(self, client):
        self.client = client
        return self.frames.popleft() if self.frames else None


@pytest.fixture
def store():
    return Scripted()


@pytest.fixture
def page(store, page_of):
    store.frames.append({"run": 1, "drill": "/d", "now": 30.0, "extent": [0.0, 30.0]})
    with serving(store) as server:
        page = page_of(server.url("/screen"))
        until_screen(page, "screen.seen.now")
        yield page
        page.assert_quiet()
        page.close()


def test_another_run_is_followed_from_its_beginning(store, page):
    of_screen(page, "screen.zoom(10, 20)")
    page.until("document.querySelector('#reach').textContent !== ''")
    until(lambda: store.client.view.follow is None)
    store.frames.append({"run": 2, "drill": "/d", "now": 1.0, "extent": [0.0, 1.0]})
    until(lambda: store.client.view.follow == 20.0)
    assert page.tab.text_content("#reach") == ""


def block(time):
    arrays = dict.fromkeys(MOTION, np.zeros(200, np.float32))
    return {"section": {"time": time, "period": 1e-4, "impacts": [], **arrays}}


def test_a_pause_shows_the_block_that_waited(store, page):
    of_screen(page, "screen.clock.speed = 1e-3")  # so slow that no block ends
    store.frames += [{"status": {"state": "running"}}, block(1.0), block(2.0)]
    until_screen(page, "screen.clock.next")
    store.frames.append({"status": {"state": "paused"}})
    until_screen(page, "screen.clock.block.time === 2 && screen.clock.resting")


def test_a_fault_shows_the_first_block_of_after_it(store, page):
    of_screen(page, "screen.clock.speed = 1e-3")
    fault = {"number": 1, "kind": "free_mass_jammed", "channel": "", "onset": 30.0, "active": True}
    store.frames += [{"status": {"state": "running"}, **block(29.0)}, {"faults": [fault]}]
    store.frames.append(block(29.9))  # it was recorded before the fault
    until_screen(page, "screen.clock.block.time === 29.9")
    until(lambda: store.client.section)  # a newer one is asked for
    store.frames.append(block(30.1))
    until_screen(page, "screen.clock.block.time === 30.1")
    store.frames.append(block(30.2))  # it waits for its turn
    until_screen(page, "screen.clock.next.time === 30.2")
