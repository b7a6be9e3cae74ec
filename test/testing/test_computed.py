"""What a test computes is, bit for bit, what the drill publishes over DDS."""

import itertools

import pytest
from support import extended

from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.topics import PROVED, offered_topics
from rpud_sim.testing import DrillError, LostMessagesError
from rpud_sim.verdicts import always, eventually, signal

ARM = {
    "feed_model": "arm",
    "rotation_model": "friction_drive",
    "rock_model": "specific_energy",
    "actuator_model": "resonance",
    "telemetry_rate": 200.0,
    "sample_rate": 20000.0,
}
FAULTS = [
    {"kind": "noise", "channel": "reacting_force", "onset": 0.05, "magnitude": 5.0},
    {"kind": "delayed", "channel": "nodal_plane", "onset": 0.1, "magnitude": 0.03},
    {"kind": "stuck", "channel": "drill_tool", "onset": 0.2, "duration": 0.1},
    {"kind": "intermittent", "channel": "contact_force", "onset": 0.1, "duration": 0.2},
    {"kind": "free_mass_jammed", "onset": 0.4, "duration": 0.1},
]


def received(drill, topic):
    """Return the topic as it came over DDS."""
    return drill._collector.own(topic)


def fly(drill, act):
    drill.step(0.0123)
    drill.step(0.3)
    drill.inject("garbage", "wrench", duration=0.05)
    drill.step(0.25)
    drill.drive(False)
    drill.step(0.1)
    drill.drive()
    act(drill)
    drill.step(0.001)
    drill.step(0.4)


@pytest.mark.parametrize(
    ("values", "act"),
    [
        ({}, lambda drill: drill.press(20.0)),
        extended({"regime": "free", "weight_on_bit": 0.0}, lambda drill: drill.press(20.0)),
        (ARM, lambda drill: drill.feed(rate=0.001)),
        extended({**ARM, "feed_model": "given"}, lambda drill: drill.move(0.006, 0.001)),
    ],
)
def test_every_topic_has_the_bits_that_came_over_dds(drill_factory, values, act):
    drill = drill_factory(**values, faults=FAULTS, seed=7)
    topics = [n for n in offered_topics(to_settings(values).values()) if n in (*PROVED, "journal")]
    for topic in topics:
        drill.listen(topic)
    for reset in (False, True):
        if reset:
            drill.reset(seed=11)
        # What is asked for from the beginning is computed with the others, what comes later alone.
        for topic in topics if values else ():
            drill.messages(topic)
        fly(drill, act)
        for topic in topics:
            assert drill.messages(topic)
            wire, own = received(drill, topic).payloads, drill.heard[f"/rpud/{topic}"].payloads
            if topic in ("faults", "journal"):  # latched: the wire has some of before
                count = min(len(wire), len(own))
                wire, own = wire[-count:], own[-count:]
            # The middleware may add bytes at the end of a message.
            assert own == [each[: len(mine)] for each, mine in zip(wire, own, strict=True)]


def test_another_bit_or_a_loss_on_the_wire_fails_the_test(drill):
    drill.listen("reacting_force")
    drill.step(0.1)
    wire = received(drill, "reacting_force")
    assert len(drill.messages("reacting_force")) == len(wire) == 10
    last = wire.payloads[-1]
    wire.payloads[-1] = last[:-1] + bytes([last[-1] ^ 1])
    with pytest.raises(DrillError, match=r"reacting_force at 0\.1 s is another one than this"):
        drill.messages("reacting_force")
    wire.payloads[-1] = last
    wire.note(wire.number + 3)
    with pytest.raises(LostMessagesError, match="2 messages of /rpud/reacting_force are lost"):
        drill.messages("reacting_force")


def test_a_drill_that_computes_other_values_fails_the_test(drill):
    drill.step(0.2)
    drill._computed._status.impacts += 1
    with pytest.raises(DrillError, match=r"impacts is \d+ there and \d+ here, at 0\.2 s"):
        drill.messages("contact_force")


def test_nothing_but_reports_is_published_to_a_test_that_listens_to_nothing(drill):
    before = drill.published
    drill.step(1.0)
    drill.messages("waveform")
    drill.expect(always(signal("reacting_force.force") < "450 N"))
    drill.expect(eventually(signal("waveform.contact_force") > "100 N"))
    published = {name for name, count in drill.published.items() if count > before[name]}
    assert published <= {"status", "power", "timing", "journal", "faults"}


def test_it_computes_the_same_in_one_step_and_in_many(drill):
    drill.step(0.5)
    drill.press(17.0)
    drill.step(0.5)
    whole = {name: each.payloads for name, each in drill.heard.items()}
    drill.reset()
    for number in itertools.count(1):
        drill.step(0.05)
        assert len(drill.messages("reacting_force")) == 5 * number
        if number == 10:
            drill.press(17.0)
        if number == 20:
            break
    found = {name: each.payloads for name, each in drill.heard.items()}
    for name in whole:
        if name.removeprefix("/rpud/") in PROVED:
            assert found[name] == whole[name], name


def test_faults_that_another_client_injects_are_computed(drill):
    drill.step(0.1)
    drill.client.inject("free_mass_jammed")
    drill.client.clear("all")
    drill.press(12.0)
    assert [fault.kind for fault in drill.latest("faults").faults] == ["free_mass_jammed"]
    assert [entry.kind for entry in drill.messages("journal")] == [
        *("begin", "origin", "inject", "clear_all", "weight_on_bit")
    ]


def test_right_after_a_reset_nothing_of_before_is_left(drill):
    drill.step(0.1)
    assert len(drill.messages("nodal_plane")) > 9
    drill.reset()
    assert len(drill.messages("nodal_plane")) <= 1
    assert all(each.header.stamp.nanosec == 0 for each in drill.messages("nodal_plane"))
