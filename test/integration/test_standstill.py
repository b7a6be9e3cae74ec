"""A recorder that stands still until the middleware has forgotten it counts what it missed."""

import os
import signal

import pytest
from drill_client import ACTIVATE, CONFIGURE, stamps
from rpud_msgs.msg import Result, SimulationState
from rpud_msgs.srv import GetDelivery
from sample_bags import PLAIN_PROVED

import rpud_sim.bag
from rpud_sim.recorded.verify import verify

SECOND = 1_000_000_000
RARE = ("faults", "journal")  # of the topics, those of which nothing comes in the standstill


@pytest.mark.extended
def test_what_a_forgotten_recorder_misses_is_counted(start_drill, connect, process, tmp_path):
    start_drill("/rpud", "waiting for the transitions", autostart="false")
    client = connect("/rpud")
    recorder = process("recorder", "--out", tmp_path / "bag")

    def delivery():
        return client.call(GetDelivery, "simulation/get_delivery", GetDelivery.Request())

    def published():
        answer = delivery()
        return dict(zip(answer.topics, answer.published, strict=True))

    def recorded():
        """Give how many topics of the drill reach the recorder; this client hears the status."""
        return sum(delivery().subscribers) - 1

    def has_all():
        """Tell whether the recorder has all that the drill, which stands still, has published."""
        return recorded() == len(topics) and delivery().acknowledged

    def set_state(state):
        assert client.set_state(state).result == Result.RESULT_OK

    def hear_all():
        """Wait until the drill has gone on with each stream, stop it, and wait for the recorder."""
        before = published()
        client.until(
            lambda: (now := published()) and all(now[name] > before[name] for name in streams)
        )
        set_state(SimulationState.STATE_PAUSED)
        client.until(has_all)

    assert client.change(CONFIGURE)
    topics = delivery().topics
    streams = [name for name in topics if name not in RARE]
    client.until(has_all)
    early = published()
    assert client.change(ACTIVATE)
    hear_all()
    set_state(SimulationState.STATE_PLAYING)
    os.kill(recorder.pid, signal.SIGSTOP)
    client.until(lambda: recorded() == 0)  # the middleware has forgotten it, after 20 s
    end = stamps(client.status)[-1] + 5 * SECOND
    client.until(lambda: stamps(client.status)[-1] > end)
    os.kill(recorder.pid, signal.SIGCONT)
    client.until(lambda: recorded() == len(topics))
    hear_all()
    sent = published()
    recorder.interrupt()
    assert recorder.wait() == 0, recorder.output

    with rpud_sim.bag.open(tmp_path / "bag") as bag:
        found = {each.topic.name.removeprefix("/rpud/"): each for each in bag.topics}
    counts = {name: found[name].message_count for name in topics}
    lost = {name: found[name].losses.total for name in topics}
    unknown = {name: sent[name] - counts[name] - lost[name] for name in topics}
    # Of a status nobody can tell how many came before the first that it got.
    assert 0 <= unknown.pop("status") < early["status"]
    assert set(unknown.values()) == {0}, unknown
    assert all(lost[name] > 0 for name in streams)
    verification = verify(tmp_path / "bag")
    assert verification.proved, verification.first_difference
    missing = {name: verification.topics[f"/rpud/{name}"].missing for name in PLAIN_PROVED}
    assert missing == {name: lost[name] for name in PLAIN_PROVED}
