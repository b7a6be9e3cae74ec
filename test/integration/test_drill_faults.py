"""Faults of a drill at work, in the rock and at resonance: seen in the ground truth and outside."""

import pytest
from drill_client import nanoseconds, stamps
from rpud_msgs.srv import ClearFault, ListFaults

from rpud_sim.simulation.topics import CHANNELS

TELEMETRY = ("nodal_plane", "reacting_force", "wrench")
PARAMETERS = {"start_paused": True, "publish_clock": True}
SCENARIO = """
seed: 4
faults:
  - {kind: lost_preload, onset: 0.1234, duration: 0.2}
  - {kind: stuck, channel: nodal_plane, onset: 0.25}
"""


@pytest.fixture(scope="module")
def drill(start_module_drill):
    models = {"rock_model": "specific_energy", "actuator_model": "resonance"}
    return start_module_drill("/faulty", weight_on_bit=30.0, **models, **PARAMETERS)


@pytest.fixture
def client(drill, connect):
    """In the rock, at time zero and paused, with every listener known."""
    client = connect("/faulty")
    topics = (*TELEMETRY, "contact_force")
    client.heard = {topic: client.listen(topic) for topic in ("faults", *topics)}
    assert client.engage(True).success
    client.until(lambda: client.reset() and client.step(0.1) and all(client.heard.values()))
    client.reset()
    for seconds in (0.02, 0.01):
        client.at(0)
        client.at(client.step(seconds))
        arrived(client)
        client.reset()
    for topic in topics:
        client.heard[topic].clear()
    return client


def arrived(client):
    """Wait for the telemetry up to the last status."""
    end = stamps(client.status[-1:])[0]
    for topic in TELEMETRY:
        client.until(lambda heard=client.heard[topic]: stamps(heard[-1:]) == [end])


def clear(client, number=0):
    response = client.call(ClearFault, "clear_fault", ClearFault.Request(number=number))
    return response.success, response.message


def truth(client, active):
    """Give the ground truth as soon as so many faults last."""

    def lasting():
        heard = client.heard["faults"]
        return sum(fault.active for fault in heard[-1].faults) == active

    client.until(lasting)
    return client.heard["faults"][-1]


def test_the_ground_truth_has_onset_and_clear_to_the_nanosecond(client, connect):
    now = client.step(0.000000123)
    first = client.inject("hard_rock", magnitude=2.0, seconds=0.123456789)
    assert (first.success, first.number) == (True, 1)
    assert client.inject("bias", "reacting_force", 3.0).number == 2
    begun = truth(client, 2)
    assert [nanoseconds(fault.onset) for fault in begun.faults] == [now, now]
    assert [nanoseconds(fault.clear) for fault in begun.faults] == [0, 0]
    client.step(0.2)
    ended = truth(client, 1).faults[0]
    assert (ended.number, ended.kind, ended.magnitude) == (1, "hard_rock", 2.0)
    assert nanoseconds(ended.clear) == now + 123_456_789
    end = client.step(0.0333)
    assert clear(client, 2) == (True, "")
    assert nanoseconds(truth(client, 0).faults[1].clear) == end
    late = connect("/faulty")
    heard = late.listen("faults")
    late.until(lambda: heard)
    assert heard[-1] == client.heard["faults"][-1]


def test_what_lasts_and_what_could_be_is_listed(client):
    assert client.inject("choking").success
    listed = client.call(ListFaults, "list_faults", ListFaults.Request())
    assert [(fault.number, fault.kind) for fault in listed.faults] == [(1, "choking")]
    assert {"free_mass_jammed", "resonance_drift", "hard_rock", "off"} <= set(listed.kinds)
    assert set(listed.channels) == set(CHANNELS) - {"mount", "rotation"}  # not published


@pytest.mark.parametrize(
    ("kind", "channel", "magnitude", "said"),
    [
        ("bias", "", 1.0, "channel"),
        ("lost_preload", "", 1.5, "1.5 is outside its range (0, 1]"),
        ("choking", "", 0.8, "already there as fault 1"),
        # The nearest, then those of this drill.
        ("nois", "wrench", 1.0, "'nois' is unknown (did you mean noise?); possible are free_mass"),
    ],
)
def test_what_cannot_be_honoured_is_refused_with_the_reason(client, kind, channel, magnitude, said):
    assert client.inject("choking").success
    refused = client.inject(kind, channel, magnitude)
    assert not refused.success
    assert refused.number == 0
    assert said in refused.message
    assert "\n" not in refused.message
    assert [fault.kind for fault in truth(client, 1).faults] == ["choking"]


@pytest.mark.extended
def test_a_scenario_comes_by_itself_at_its_times_and_again_after_a_reset(
    start_drill, connect, tmp_path
):
    path = tmp_path / "scenario.yaml"
    path.write_text(SCENARIO)
    start_drill("/scripted", scenario=path, **PARAMETERS)
    client = connect("/scripted")
    heard = client.listen("faults")

    def lasting():
        return [
            (fault.kind, fault.channel, nanoseconds(fault.onset), nanoseconds(fault.clear))
            for fault in heard[-1].faults
        ]

    client.until(lambda: heard and not lasting())
    for _ in range(2):
        client.step(0.5)
        expected = [
            ("lost_preload", "", 123_400_000, 323_400_000),
            ("stuck", "nodal_plane", 250_000_000, 0),
        ]
        client.until(lambda expected=expected: lasting() == expected)
        client.reset()
        client.until(lambda: not lasting())
