"""A real drill, heard and commanded over DDS in the tests' own domain."""

import pytest
from support import Process, until

from rpud_sim.ros.client.drill_finder import DrillFinder
from rpud_sim.ros.starting import StartError
from rpud_sim.watch.drill_pool import DrillPool, NoDrillToShowError
from rpud_sim.watch.live_drill import LiveDrill

NAMESPACE = "/live_drill"


def start():
    return Process("drill_node", "--ros-args", "-r", f"__ns:={NAMESPACE}")


@pytest.fixture(scope="module")
def drill():
    with start() as running:
        yield running


@pytest.fixture(scope="module")
def live(drill):
    with LiveDrill(NAMESPACE) as found:
        until(lambda: found.picture().kinds)
        yield found


def outcome_of(live, name, **arguments):
    number = live.act(name, **arguments)

    def settled():
        return [
            each
            for each in live.picture().outcomes
            if each.number == number and each.state != "waiting"
        ]

    until(settled)
    return settled()[0]


def test_everything_is_received_and_nothing_is_lost(live):
    until(lambda: live.picture().section is not None and len(live.picture().series.rows) > 5)
    picture = live.picture()
    assert picture.connection.state == "connected"
    assert picture.status["state"] == "running"
    assert set(picture.latest) == {"nodal_plane", "drill_tool", "reacting_force", "actuator_state"}
    assert not any(picture.lost.values())
    assert picture.status["commanders"] == 0  # who only looks commands nothing
    impacts = picture.impacts
    assert [each.sequence for each in impacts] == [
        impacts[0].sequence + number for number in range(len(impacts))
    ]
    assert picture.series.column("impacts")[1:-3].min() > 0


def test_an_action_is_done_or_refused_with_the_drills_reason(live):
    assert outcome_of(live, "press", force=21.0).state == "done"
    until(lambda: live.picture().status["weight_on_bit"] == 21.0)
    refused = outcome_of(live, "press", force=-1.0)
    assert (refused.state, refused.text) == (
        "refused",
        "weight_on_bit = -1 N is outside its range [0, 1000] N",
    )
    refused = outcome_of(live, "step", seconds=1.0)
    assert (refused.state, refused.text) == ("refused", "it is playing, not paused")
    wrong = outcome_of(live, "press", force="much")
    assert (wrong.state, wrong.text) == ("refused", "force = 'much' is not a number")


def test_a_fault_is_shown_from_its_onset_to_its_end(live):
    assert outcome_of(live, "inject", kind="free_mass_jammed").text.startswith("fault ")
    until(lambda: live.picture().faults and live.picture().faults[-1].active)
    assert outcome_of(live, "clear").state == "done"
    until(lambda: not live.picture().faults[-1].active)
    fault = live.picture().faults[-1]
    assert fault.kind == "free_mass_jammed"
    assert 0.0 < fault.onset < fault.end <= live.picture().time


def test_a_pause_need_not_wait_for_a_long_step(live):
    assert outcome_of(live, "pause").state == "done"
    long = live.act("step", seconds=1000.0)
    until(lambda: live.picture().status["state"] == "running")
    assert outcome_of(live, "pause").state == "done"
    outcome = next(each for each in live.picture().outcomes if each.number == long)
    assert (outcome.state, outcome.text) == ("failed", "interrupted")
    assert outcome_of(live, "play").state == "done"


@pytest.mark.extended
def test_a_drill_comes_later_vanishes_and_returns_as_a_new_run():
    with LiveDrill("/comes_later") as live:
        assert live.picture().connection.state == "searching"
        runs = []
        for _ in range(2):
            with Process("drill_node", "--ros-args", "-r", "__ns:=/comes_later"):
                until(lambda: live.picture().connection.state == "connected")
                assert outcome_of(live, "press", force=15.0).state == "done"
                runs.append(live.picture().run)
            until(lambda: live.picture().connection.state == "vanished")
            assert "is gone" in live.picture().connection.reason
        assert runs == [1, 2]
        failed = outcome_of(live, "press", force=15.0)
        assert failed.state == "failed"
        assert "no drill in /comes_later" in failed.text


def test_pages_share_one_drill_which_stays_a_while_after_the_last(drill):
    now = [0.0]
    pool = DrillPool(lambda: {NAMESPACE, "/a b"}, clock=lambda: now[0])
    try:
        first = pool.take(NAMESPACE)
        assert pool.take(NAMESPACE) is first
        pool.release(first)
        pool.close_unused(10.0)
        assert pool.take(NAMESPACE) is first
        pool.release(first)
        pool.release(first)
        now[0] = 9.0
        pool.close_unused(10.0)
        assert pool.take(NAMESPACE) is first
        pool.release(first)
        now[0] = 20.0
        pool.close_unused(10.0)
        assert pool.take(NAMESPACE) is not first
        with pytest.raises(StartError, match="Invalid namespace"):
            pool.take("/a b")
        with pytest.raises(NoDrillToShowError, match="there is no drill in /x"):
            pool.take("/x")
    finally:
        pool.close()


def test_a_list_has_the_drill_and_what_it_says(drill):
    with DrillFinder() as finder:

        def found():
            return [each for each in finder.drills() if each.namespace == NAMESPACE and each.state]

        until(found)
        assert found()[0].regime == "drilling"
