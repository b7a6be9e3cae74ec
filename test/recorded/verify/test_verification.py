"""What a bag proves, and what it does not: altered, shortened and torn apart."""

import dataclasses
import struct

import pytest
from altered_bags import altered, flipped, merged, messages_of, numbered
from inspection.forked_runs import write_used
from inspection.verify.proof_bags import DURATION, JOURNAL, ON_ARM
from rpud_sim.recorded.recorded_journal import UnverifiableError, installed_codec
from rpud_sim.recorded.verify.verification import PROVED, verify
from sample_bags import write_offline_bag

import rpud_sim.bag
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.simulation import preset
from rpud_sim.simulation.topics import TOPICS

INSTALLED = installed_codec(TOPICS["journal"].type)
# Field of each type, and where it lies from the end of the message, or from its beginning [bytes].
FIELDS = {
    "actuator_state": ("temperature", -8),
    "borehole": ("side_offset", -8),
    "contact_force": ("energy_transferred", -9),
    "drill_tool": ("in_contact", -1),
    "faults": ("forgotten", -8),
    "joint_states": ("effort[2]", -8),
    "mount": ("slip", -8),
    "nodal_plane": ("velocity", -8),
    "reacting_force": ("force", -8),
    "rotation": ("stalled", -1),
    "trajectory": ("drill_tool_sine[", -8),
    "waveform": ("reacting_force[", -8),
    "wrench": ("wrench.force.z", -32),
}


def totals(verification):
    """Return the numbers of equal, different, missing and unexpected messages."""
    counts = verification.topics.values()
    return tuple(
        sum(getattr(count, name) for count in counts)
        for name in ("equal", "different", "missing", "unexpected")
    )


def test_an_offline_bag_is_proved(bag):
    verification = verify(bag)
    assert verification.proved
    assert (verification.warnings, verification.simulated) == ((), round(DURATION * 1e9))
    assert set(verification.topics) == {f"/rpud/{name}" for name in PROVED if name not in ON_ARM}
    held = [m for m in messages_of(bag) if m.topic not in (JOURNAL, "/rpud/status")]
    assert totals(verification) == (len(held), 0, 0, 0)
    assert set(verification.lost.values()) == {0}


@pytest.mark.parametrize("topic", PROVED)
def test_one_flipped_bit_is_named(request, tmp_path, topic):
    bag = request.getfixturevalue("arm" if topic in ON_ARM else "bag")
    number = 2
    original = messages_of(bag, {f"/rpud/{topic}"})[number]
    change = numbered(topic, number, lambda m: [flipped(m.data, FIELDS[topic][1])])
    verification = verify(altered(bag, tmp_path / "bag", change))
    difference = verification.first_difference
    assert totals(verification)[1:] == (1, 0, 0)
    seconds, rest = struct.unpack_from("<iI", original.data, 4)
    assert (difference.topic, difference.stamp, difference.log_time) == (
        f"/rpud/{topic}",
        seconds * 1_000_000_000 + rest,
        original.log_time,
    )
    assert difference.field.startswith(FIELDS[topic][0])
    assert difference.recorded != difference.computed


def put_in(message):
    other = bytearray(message.data)
    struct.pack_into("<I", other, 8, struct.unpack_from("<I", other, 8)[0] + 1)
    return [message.data, bytes(other)]


@pytest.mark.parametrize(
    ("topic", "change", "unexpected", "field", "recorded"),
    [
        ("nodal_plane", lambda m: [flipped(m.data, 8, 3)], 0, "header.stamp.nanosec", ""),
        ("wrench", lambda m: [m.data[:20]], 0, "", "cannot be understood"),
        ("nodal_plane", put_in, 1, "", "a message"),
        ("wrench", lambda m: [m.data, m.data], 1, "", "a message"),
    ],
    ids=["stamp", "bytes", "put in", "duplicate"],
)
def test_what_is_altered_or_added_is_named(
    bag, tmp_path, topic, change, unexpected, field, recorded
):
    verification = verify(altered(bag, tmp_path / "bag", numbered(topic, 7, change)))
    assert totals(verification)[1:] == (1 - unexpected, 0, unexpected)
    difference = verification.first_difference
    assert (difference.topic, difference.field) == (f"/rpud/{topic}", field)
    assert recorded in difference.recorded
    assert (difference.computed is None) == bool(unexpected)


def test_padding_between_fields_is_ignored(bag, tmp_path):
    codec = Codec("rpud_msgs/msg/ReactingForce", find_definition("rpud_msgs/msg/ReactingForce"))
    original = messages_of(bag, {"/rpud/reacting_force"})[3].data
    place = len(original) - 9  # the frame's name ends at an odd place, and a double does not
    assert codec.encode(codec.decode(flipped(original, place))) == original
    change = numbered("reacting_force", 3, lambda m: [flipped(m.data, place)])
    assert verify(altered(bag, tmp_path / "bag", change)).proved


def test_a_repeated_message_of_a_latched_topic_is_none_of_its_own(bag, tmp_path):
    def twice(message):
        latched = message.topic in (JOURNAL, "/rpud/faults")
        return [message.data] * (2 if latched else 1)

    verification = verify(altered(bag, tmp_path / "bag", twice))
    assert verification.proved
    assert totals(verification)[1:] == (0, 0, 0)


def test_a_start_that_says_the_same_as_the_one_before_is_another_start(bag, tmp_path):
    # A node that is its own clock, cleaned up and activated again, or killed and started again.
    later = 10 * 1_000_000_000
    path = merged(tmp_path / "bag", (bag, 0, "/rpud"), (bag, later, "/rpud"))
    once, twice = verify(bag), verify(path)
    assert twice.proved
    assert twice.simulated == 2 * once.simulated
    assert twice.topics["/rpud/wrench"].equal == 2 * once.topics["/rpud/wrench"].equal


def in_wrong_order(bag, folder, change=lambda message: message.data):
    """Write a bag of two runs, of which the second one's messages come before the first one's."""
    second = folder / "second"
    write_offline_bag(second, preset("drilling"), DURATION, 0.7, None, 12)
    first_journal, second_journal = (messages_of(path, {JOURNAL}) for path in (bag, second))
    others = [m for path in (second, bag) for m in messages_of(path) if m.topic != JOURNAL]
    with rpud_sim.bag.open(bag) as reader, rpud_sim.bag.BagWriter(folder / "bag") as writer:
        for summary in reader.topics:
            writer.add_topic(summary.topic, summary.definition)
        for number, message in enumerate((*first_journal, *second_journal, *others)):
            writer.write_message(message.topic, change(message), number, number)
    return folder / "bag"


def test_messages_that_only_another_run_gives_are_not_called_different(bag, tmp_path):
    verification = verify(in_wrong_order(bag, tmp_path))
    assert not verification.proved
    assert verification.first_difference is None
    assert verification.undecided.startswith("the bag holds 2 runs, and it cannot be decided which")


def test_a_message_that_no_run_gives_differs_in_any_order(bag, tmp_path):
    change = numbered("wrench", 12, lambda m: [flipped(m.data, FIELDS["wrench"][1])])
    path = in_wrong_order(bag, tmp_path, lambda message: change(message)[0])
    verification = verify(path)
    assert verification.first_difference.topic == "/rpud/wrench"
    stamp = struct.unpack_from("<iI", messages_of(path, {"/rpud/wrench"})[12].data, 4)
    assert verification.first_difference.stamp == stamp[0] * 1_000_000_000 + stamp[1]


def test_lost_messages_are_counted_and_the_others_proved(bag, tmp_path):
    numbers = iter(range(1_000_000))
    dropped = []

    def lossy(message):
        lost = message.topic not in (JOURNAL, "/rpud/faults") and next(numbers) % 7 == 3
        dropped.extend([message] * lost)
        return [] if lost else [message.data]

    verification = verify(altered(bag, tmp_path / "bag", lossy))
    assert (verification.first_difference, verification.undecided) == (None, "")
    total = verification.total
    assert total.missing > 0
    assert total.tail > 0
    assert total.missing + total.tail <= len(dropped)
    held = [m for m in messages_of(tmp_path / "bag") if m.topic not in (JOURNAL, "/rpud/status")]
    assert totals(verification)[0] == len(held)


def test_a_recording_of_a_part_is_proved(bag, tmp_path):
    def part(message):
        inside = 0.1e9 < message.log_time < 0.3e9
        begun = message.topic == JOURNAL and message.log_time == 0
        return [message.data] if inside or begun else []

    verification = verify(altered(bag, tmp_path / "bag", part))
    assert verification.proved
    assert totals(verification)[2:] == (0, 0)
    assert verification.topics["/rpud/nodal_plane"].equal == 19


def test_a_journal_that_begins_with_a_later_run_proves_that_run(tmp_path):
    write_used(tmp_path / "whole", {})
    begun = []

    def of_the_second_run(message):
        if message.topic == JOURNAL and INSTALLED.decode(message.data).kind == "begin":
            begun.append(message)
        return [] if message.topic == JOURNAL and len(begun) < 2 else [message.data]

    verification = verify(altered(tmp_path / "whole", tmp_path / "bag", of_the_second_run))
    assert verification.first_difference is None
    assert verification.undecided.endswith("messages are of before the journal begins")
    assert verification.topics["/rpud/faults"].before > 0


@pytest.mark.parametrize(
    ("old", "new"), [("float64 energy ", "float32 energy "), ("float64 energy ", "float64 power ")]
)
def test_a_type_with_a_field_of_its_own_cannot_be_proved(bag, tmp_path, old, new):
    definition = find_definition("rpud_msgs/msg/ContactForce").replace(old, new)
    out = tmp_path / "bag"
    with rpud_sim.bag.open(bag) as reader, rpud_sim.bag.BagWriter(out) as writer:
        for summary in reader.topics:
            topic, text = summary.topic, summary.definition
            if topic.name == "/rpud/contact_force":
                other = Codec(topic.type, definition)
                topic, text = dataclasses.replace(topic, type_hash=other.type_hash), definition
            writer.add_topic(topic, text)
        for message in reader.messages():
            writer.write_message(
                message.topic, message.data, message.log_time, message.publish_time
            )
    with pytest.raises(UnverifiableError, match="/rpud/contact_force is of another version of"):
        verify(out)
