"""A real drill, heard and commanded over DDS, as a browser without a screen sees it."""

import time
from contextlib import contextmanager

import numpy as np
import pytest
from drill_client import start_drill
from screen_client import ClosedError, ScreenClient, serving

from rpud_sim.foundation.quantities import ExpectedError
from rpud_sim.ros.client.listening_node import DrillFinder
from rpud_sim.viewer.frames import ClientState
from rpud_sim.viewer.live import LiveStore

NAMESPACE = "/live_drill"


@contextmanager
def watched(namespace):
    """Serve a drill as `rpud watch` does; the value is the server."""
    with DrillFinder() as finder:
        store = LiveStore(finder, namespace)
        try:
            with serving(store) as server:
                yield server
        finally:
            store.end()


@pytest.fixture(scope="module")
def drill():
    with start_drill(NAMESPACE, rock_model="specific_energy") as running:
        yield running


@pytest.fixture(scope="module")
def server(drill):
    with watched(NAMESPACE) as running:
        yield running


@pytest.fixture
def client(server):
    with ScreenClient(server.port) as found:
        found.until(lambda seen: seen.get("kinds") and "numbers" in seen)
        yield found


def outcome_of(client, act, **arguments):
    """Act, and return state and text of the outcome."""
    before = [each["number"] for each in client.seen["outcomes"]]
    client.send({"act": act, "arguments": arguments})

    def settled(seen):
        new = [each for each in seen["outcomes"] if each["number"] not in before]
        return next((each for each in new if each["name"] == act), None)

    outcome = client.until(settled)
    return outcome["state"], outcome["text"]


def has_every_impact(section):
    begins = np.diff((section["contact_force"] > 0.0).astype(int)) == 1
    return len(section["impacts"]) >= np.count_nonzero(begins)


def test_everything_is_received_and_nothing_is_lost(client):
    client.until(lambda seen: len(seen["view"]["layers"]["peak_force"]["t"]) > 5)
    client.until(lambda seen: "section" in seen and "timeline" in seen)
    topics = {"nodal_plane", "drill_tool", "reacting_force", "actuator_state", "contact_force"}
    client.until(lambda seen: topics <= set(seen["values"]))
    # Numbers come at a period of their own: the first ones may be of before the impacts.
    client.until(lambda seen: seen["numbers"]["impact_rate"]["mean"] > 100.0)
    seen = client.seen
    assert seen["mode"] == "live"
    assert NAMESPACE in seen["drills"]
    assert seen["connection"]["state"] == "connected"
    assert seen["status"]["state"] == "running"
    assert seen["status"]["commanders"] == 0  # who only looks commands nothing
    assert seen["losses"] == {}
    assert [plot["id"] for plot in seen["plots"]] == ["peak_force", "load", "motion", "more"]
    number = seen["numbers"]["peak_force"]
    assert number["least"] <= number["mean"] <= number["greatest"]
    section = seen["section"]
    assert len(section["free_mass"]) * section["period"] == pytest.approx(0.02)

    # Topics have no common order: a picture may miss impacts, and each one is asked for.
    while not has_every_impact(client.seen.pop("section")):
        client.send({"section": True})
        client.until(lambda seen: seen["section"])
    assert np.ptp(section["free_mass"]) > 1e-4
    layer = seen["view"]["layers"]["reacting_force"]
    assert (layer["low"] <= layer["mean"]).all()
    assert (layer["mean"] <= layer["high"]).all()
    client.until(lambda seen: seen.get("hole") and seen["hole"]["depth"] > 0.0)
    assert [layer["name"] for layer in client.seen["hole"]["layers"]] == ["rock"]


def test_an_action_is_done_or_refused_in_the_users_words(client):
    client.until(lambda seen: "log" in seen)
    assert outcome_of(client, "press", force=21.0) == ("done", "")
    client.until(lambda seen: seen["status"]["weight_on_bit"] == 21.0)
    client.until(lambda seen: seen["log"][-1]["text"] == "weight on bit 21 N")
    client.until(lambda seen: seen["steps"]["weight_on_bit"]["v"][-1] == 21.0)
    commands = [each for each in client.seen["log"] if each["kind"] == "command"]
    assert outcome_of(client, "press", force=21.0)[0] == "done"
    assert outcome_of(client, "press", force=-1.0) == ("refused", "-1 N is below 0 N")
    assert outcome_of(client, "press", force=9999) == ("refused", "9999 N is above 1000 N")
    assert outcome_of(client, "step", seconds=1.0) == (
        "refused",
        "it is playing, not paused, as after `rpud pause`",
    )
    assert outcome_of(client, "press", force="a")[1] == "force = 'a' is not a number"
    assert [
        each for each in client.seen["log"] if each["kind"] == "command"
    ] == commands  # no value has changed
    client.send({"act": "close"})
    assert "'close' is unknown" in client.until(lambda seen: seen.get("refused"))[1]


def test_a_pause_need_not_wait_for_a_long_step(client):
    assert outcome_of(client, "pause")[0] == "done"
    client.send({"act": "step", "arguments": {"seconds": 1000.0}})
    client.until(lambda seen: seen["status"]["state"] == "running")
    assert outcome_of(client, "pause")[0] == "done"
    step = next(each for each in client.seen["outcomes"][::-1] if each["name"] == "step")
    assert (step["state"], step["text"]) == ("failed", "interrupted")
    assert outcome_of(client, "play")[0] == "done"


def test_a_reset_begins_another_run_on_each_page_and_the_past_goes(client, server):
    with ScreenClient(server.port, f"?namespace={NAMESPACE}") as other:
        run = other.until(lambda seen: seen.get("run") and seen.get("extent") and seen["run"])
        client.send({"act": "press", "arguments": {"force": 17.0}})
        other.until(lambda seen: seen.get("status", {}).get("weight_on_bit") == 17.0)
        asked = time.monotonic()
        client.send({"act": "reset"})
        for each in (client, other):
            each.until(lambda seen: seen["run"] == run + 1 and seen.get("extent"))
            assert each.seen["extent"][1] < time.monotonic() - asked + 0.1
            each.until(lambda seen: seen.get("status", {}).get("weight_on_bit") == 8.0)
            assert each.seen["log"][0]["text"] == "a run begins"


def test_a_thread_that_dies_ends_the_page_with_a_message(drill, monkeypatch):
    monkeypatch.setattr("threading.excepthook", lambda error: None)
    with watched(NAMESPACE) as server, ScreenClient(server.port) as client:
        client.until(lambda seen: "numbers" in seen)
        live = server.store.heard[NAMESPACE]
        monkeypatch.setattr(live, "_settle", lambda: 1 / 0)
        error = client.until(lambda seen: seen.get("error"))
        assert error.endswith("has ended: ZeroDivisionError: division by zero")
        with pytest.raises(ClosedError):
            client.frame()
        with ScreenClient(server.port) as again:
            again.until(lambda seen: "numbers" in seen)


@pytest.mark.extended
def test_a_drill_comes_later_vanishes_and_returns_as_a_new_run():
    with watched("/comes_later") as server, ScreenClient(server.port) as client:
        client.until(lambda seen: seen["connection"]["state"] == "searching")
        for run in (1, 2):
            with start_drill("/comes_later"):
                client.until(lambda seen: seen["connection"]["state"] == "connected")
                client.until(lambda seen, run=run: seen.get("run") == run and "numbers" in seen)
                assert outcome_of(client, "press", force=15.0)[0] == "done"
            client.until(lambda seen: seen["connection"]["state"] == "vanished")
            assert "is gone" in client.seen["connection"]["reason"]
            assert "numbers" in client.seen  # what was heard stays
        state, text = outcome_of(client, "press", force=15.0)
        assert state == "failed"
        assert "no drill in /comes_later" in text


def test_pages_share_one_drill_and_one_that_has_gone_leaves_its_place(drill, monkeypatch):
    monkeypatch.setattr("rpud_sim.viewer.live.MOST_DRILLS", 1)
    with DrillFinder() as finder:
        store = LiveStore(finder, NAMESPACE)
        try:
            for name in ("", NAMESPACE):
                store.open(ClientState(name))
            [shared] = store.heard.values()
            with pytest.raises(ExpectedError, match="there is no drill in /x"):
                store.open(ClientState("/x"))
            monkeypatch.setattr(DrillFinder, "drills", lambda _: ["/x"])
            with pytest.raises(ExpectedError, match="1 drills are shown already"):
                store.open(ClientState("/x"))
            shared.error = "it has ended"
            store.open(ClientState("/x"))
            assert [*store.heard] == ["/x"]
            with pytest.raises(ExpectedError, match="Invalid namespace"):
                LiveStore(finder, "/a b").open(ClientState())
        finally:
            store.end()
