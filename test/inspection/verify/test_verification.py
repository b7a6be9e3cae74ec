"""What a bag proves, and what it does not: altered, shortened and torn apart."""

import dataclasses
import json
import struct

import pytest
from altered_bags import altered, unchanged
from sample_bags import write_offline_bag

import rpud_sim.bag
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.inspection.offline_bag import write_offline_bag as write_bag
from rpud_sim.inspection.verify.recorded_journal import UnverifiableError
from rpud_sim.inspection.verify.verification import PROVED, verify
from rpud_sim.simulation import preset
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.run import Beginning
from rpud_sim.simulation.scenario import parse_scenario

DURATION = 0.33
JOURNAL = "/rpud/journal"
ARM = {
    "feed_model": "arm",
    "initial_feed": 0.005,
    "rotation_model": "friction_drive",
    "strata": "sandstone",
}
ON_ARM = ("borehole", "mount", "rotation")
# Where a field of each type lies from the end of the message, or from its beginning [bytes].
PLACES = {
    "actuator_state": -8,
    "borehole": -8,
    "contact_force": -9,
    "drill_tool": -1,
    "faults": -8,
    "joint_states": -8,
    "mount": -8,
    "nodal_plane": -8,
    "reacting_force": -8,
    "rotation": -1,
    "trajectory": -8,
    "waveform": -8,
    "wrench": -32,
}
FIELDS = {
    "actuator_state": "temperature",
    "borehole": "side_offset",
    "contact_force": "energy_transferred",
    "drill_tool": "in_contact",
    "faults": "forgotten",
    "joint_states": "effort[2]",
    "mount": "slip",
    "nodal_plane": "velocity",
    "reacting_force": "force",
    "rotation": "slipping",
    "trajectory": "drill_tool_sine[",
    "waveform": "reacting_force[",
    "wrench": "wrench.force.z",
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("proof") / "bag"
    scenario = parse_scenario(
        {
            "seed": 1,
            "faults": [
                {"kind": "lost_preload", "onset": 0.1, "duration": 0.15},
                {"kind": "noise", "channel": "wrench", "onset": 0.2},
                {"kind": "garbage", "channel": "reacting_force", "onset": 0.1, "duration": 0.1},
            ],
        },
        "scenario",
    )
    write_offline_bag(path, preset("drilling"), DURATION, 0.2, scenario, 11)
    return path


@pytest.fixture(scope="module")
def arm_bag(tmp_path_factory):
    """Return the bag of a drill that rotates on an arm in a rock."""
    path = tmp_path_factory.mktemp("arm") / "bag"
    write_bag(path, Beginning(to_settings(ARM)), 0.1)
    return path


def flipped(data, place, bit=0):
    """Return data with one bit flipped."""
    changed = bytearray(data)
    changed[place] ^= 1 << bit
    return bytes(changed)


def numbered(topic, number, change):
    """Return a change of the message of that number on a topic, and of no other."""
    count = iter(range(1_000_000))

    def apply(message):
        if message.topic == f"/rpud/{topic}" and next(count) == number:
            return change(message)
        return [message.data]

    return apply


def totals(verification):
    """Return the numbers of equal, different, missing and unexpected messages."""
    counts = verification.topics.values()
    return tuple(
        sum(getattr(count, name) for count in counts)
        for name in ("equal", "different", "missing", "unexpected")
    )


def messages_of(path, topics=None):
    with rpud_sim.bag.open(path) as opened:
        return list(opened.messages(topics))


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
    bag = request.getfixturevalue("arm_bag" if topic in ON_ARM else "bag")
    number = 2
    original = messages_of(bag, {f"/rpud/{topic}"})[number]
    change = numbered(topic, number, lambda m: [flipped(m.data, PLACES[topic])])
    verification = verify(altered(bag, tmp_path / "bag", change))
    difference = verification.first_difference
    assert totals(verification)[1:] == (1, 0, 0)
    seconds, rest = struct.unpack_from("<iI", original.data, 4)
    assert (difference.topic, difference.stamp, difference.log_time) == (
        f"/rpud/{topic}",
        seconds * 1_000_000_000 + rest,
        original.log_time,
    )
    assert difference.field.startswith(FIELDS[topic])
    assert difference.recorded != difference.computed


def test_another_stamp_is_named(bag, tmp_path):
    change = numbered("nodal_plane", 7, lambda m: [flipped(m.data, 8, 3)])
    verification = verify(altered(bag, tmp_path / "bag", change))
    assert totals(verification)[1:] == (1, 0, 0)
    assert verification.first_difference.field == "header.stamp.nanosec"


def test_bytes_that_are_no_message_are_named(bag, tmp_path):
    change = numbered("wrench", 7, lambda m: [m.data[:20]])
    verification = verify(altered(bag, tmp_path / "bag", change))
    assert totals(verification)[1:] == (1, 0, 0)
    assert "cannot be understood" in verification.first_difference.recorded


def test_what_lies_between_fields_is_nobodys(bag, tmp_path):
    codec = Codec("rpud_msgs/msg/ReactingForce", find_definition("rpud_msgs/msg/ReactingForce"))
    original = messages_of(bag, {"/rpud/reacting_force"})[3].data
    place = len(original) - 9  # the frame's name ends at an odd place, and a double does not
    assert codec.without_padding(flipped(original, place)) == original
    change = numbered("reacting_force", 3, lambda m: [flipped(m.data, place)])
    assert verify(altered(bag, tmp_path / "bag", change)).proved


def test_a_message_that_was_put_in_is_unexpected(bag, tmp_path):
    def twice(message):
        other = bytearray(message.data)
        struct.pack_into("<I", other, 8, struct.unpack_from("<I", other, 8)[0] + 1)
        return [message.data, bytes(other)]

    verification = verify(altered(bag, tmp_path / "bag", numbered("nodal_plane", 7, twice)))
    assert totals(verification)[1:] == (0, 0, 1)
    assert verification.first_difference.computed is None


def test_a_repeated_message_is_none_of_its_own(bag, tmp_path):
    def twice(message):
        latched = message.topic in (JOURNAL, "/rpud/faults")
        return [message.data] * (2 if latched else 1)

    verification = verify(altered(bag, tmp_path / "bag", twice))
    assert verification.proved
    assert totals(verification)[1:] == (0, 0, 0)


def test_a_start_that_says_the_same_as_the_one_before_is_another_start(bag, tmp_path):
    # A node that is its own clock, cleaned up and activated again, or killed and started again.
    later = 10 * 1_000_000_000
    with rpud_sim.bag.open(bag) as reader, rpud_sim.bag.BagWriter(tmp_path / "bag") as writer:
        for summary in reader.topics:
            writer.add_topic(summary.topic, summary.definition)
        for shift in (0, later):
            for message in reader.messages():
                times = (message.log_time + shift, message.publish_time + shift)
                writer.write(message.topic, message.data, *times)
    once, twice = verify(bag), verify(tmp_path / "bag")
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
            writer.write(message.topic, change(message), number, number)
    return folder / "bag"


def test_messages_that_only_another_run_gives_are_not_called_different(bag, tmp_path):
    verification = verify(in_wrong_order(bag, tmp_path))
    assert not verification.proved
    assert verification.first_difference is None
    assert verification.undecided.startswith("the bag holds 2 runs, and it cannot be decided which")


def test_a_message_that_no_run_gives_differs_in_any_order(bag, tmp_path):
    change = numbered("wrench", 12, lambda m: [flipped(m.data, PLACES["wrench"])])
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
    missing = sum(count.missing for count in verification.topics.values())
    assert missing > 0
    assert verification.tail > 0
    assert missing + verification.tail <= len(dropped)
    held = [m for m in messages_of(tmp_path / "bag") if m.topic not in (JOURNAL, "/rpud/status")]
    assert totals(verification)[0] == len(held)


def seconds_of(path, duration):
    """Write an offline bag of some seconds."""
    write_offline_bag(path, preset("drilling"), duration, 0.2, None, 11)
    return path


@pytest.fixture(scope="module")
def longer_bag(tmp_path_factory):
    return seconds_of(tmp_path_factory.mktemp("longer") / "bag", 4.0)


def without(*topics, after, before=10**12):
    """Return a change that takes the messages of topics between two times of the bag [s]."""
    names = {f"/rpud/{topic}" for topic in topics}

    def change(message):
        inside = after <= message.log_time / 1e9 <= before
        return [] if message.topic in names and inside else [message.data]

    return change


@pytest.mark.parametrize(
    "kept", [PROVED, ("contact_force",), ("contact_force", "nodal_plane")], ids=len
)
def test_impacts_that_are_missing_at_the_end_are_counted(longer_bag, tmp_path, kept):
    impacts = [m for m in messages_of(longer_bag, {"/rpud/contact_force"}) if m.log_time > 2e9]
    topics = {JOURNAL, "/rpud/status", *(f"/rpud/{name}" for name in kept)}
    change = without("contact_force", after=2.0)
    verification = verify(altered(longer_bag, tmp_path / "bag", change, topics))
    assert not verification.proved
    assert (verification.first_difference, verification.undecided) == (None, "")
    counts = verification.topics["/rpud/contact_force"]
    assert (counts.tail, counts.missing) == (len(impacts), 0)
    assert verification.tail == len(impacts)


def test_other_topics_show_that_messages_are_missing_at_the_end(longer_bag, tmp_path):
    """As a recorder leaves it that is closed while the drill goes on."""
    topics = {JOURNAL, "/rpud/contact_force", "/rpud/nodal_plane"}
    impacts = messages_of(longer_bag, {"/rpud/contact_force"})

    def change(message):
        ended = message.topic == JOURNAL and message.log_time > 0
        deaf = message.topic == "/rpud/contact_force" and message.log_time > 1e9
        return [] if ended or deaf else [message.data]

    verification = verify(altered(longer_bag, tmp_path / "bag", change, topics))
    assert not verification.proved
    # The last second shows nothing: a closed recorder leaves messages behind.
    expected = sum(1e9 < m.log_time < 2.97e9 for m in impacts)
    assert expected <= verification.tail <= expected + 10


def test_a_topic_that_was_never_heard_is_missing_too(longer_bag, tmp_path):
    change = without("contact_force", after=0.0)
    verification = verify(altered(longer_bag, tmp_path / "bag", change))
    assert not verification.proved
    assert verification.topics["/rpud/contact_force"].tail > 900


def test_messages_under_way_when_a_recorder_is_closed_are_not_missing(longer_bag, tmp_path):
    """Each topic ends a little before the other, and the drill goes on."""
    names = [name for name in (*PROVED, "status") if name not in ON_ARM]
    ends = {f"/rpud/{name}": 3.5 - 0.03 * i for i, name in enumerate(names)}

    def change(message):
        return [message.data] if message.log_time / 1e9 < ends.get(message.topic, 0.1) else []

    verification = verify(altered(longer_bag, tmp_path / "bag", change))
    assert verification.proved


def test_a_topic_that_falls_silent_and_is_heard_again_is_missing_in_between(longer_bag, tmp_path):
    change = without("contact_force", after=1.0, before=3.0)
    verification = verify(altered(longer_bag, tmp_path / "bag", change))
    assert verification.proved
    assert verification.topics["/rpud/contact_force"].missing > 700


def test_a_recording_of_a_part_is_proved(bag, tmp_path):
    def part(message):
        inside = 0.1e9 < message.log_time < 0.3e9
        begun = message.topic == JOURNAL and message.log_time == 0
        return [message.data] if inside or begun else []

    verification = verify(altered(bag, tmp_path / "bag", part))
    assert verification.proved
    assert totals(verification)[2:] == (0, 0)
    assert verification.topics["/rpud/nodal_plane"].equal == 19


def edited(edit):
    """Return a change of the journal's first entry."""
    codec = Codec("rpud_msgs/msg/JournalEntry", find_definition("rpud_msgs/msg/JournalEntry"))

    def change(message):
        if message.topic != JOURNAL:
            return [message.data]
        entry = codec.decode(message.data)
        if entry.kind != "begin":
            return [message.data]
        content = json.loads(entry.content)
        edit(content)
        stamp = {"sec": entry.header.stamp.sec, "nanosec": entry.header.stamp.nanosec}
        fields = {
            "header": {"stamp": stamp, "frame_id": entry.header.frame_id},
            "sequence": entry.sequence,
            "kind": entry.kind,
            "content": json.dumps(content),
        }
        return [codec.encode(fields)]

    return change


def test_other_parameters_in_the_journal_do_not_go_with_the_messages(bag, tmp_path):
    def edit(content):
        content["parameters"]["load_spring_rate"] *= 1.0 + 2.0**-52

    verification = verify(altered(bag, tmp_path / "bag", edited(edit)))
    assert not verification.proved
    assert (verification.warnings, verification.other_versions) == ((), False)


def test_other_versions_are_told(bag, tmp_path):
    def edit(content):
        content["made_by"]["numpy"] = "0.0.1"

    verification = verify(altered(bag, tmp_path / "bag", edited(edit)))
    assert verification.proved
    assert verification.other_versions
    [warning] = verification.warnings
    assert warning.startswith("made by numpy 0.0.1, verified by ")


def test_a_bag_without_a_journal_cannot_be_verified(bag, tmp_path):
    topics = {f"/rpud/{name}" for name in PROVED}
    altered(bag, tmp_path / "bag", unchanged, topics)
    with pytest.raises(UnverifiableError, match="holds no journal"):
        verify(tmp_path / "bag")


def test_a_journal_alone_proves_nothing(bag, tmp_path):
    altered(bag, tmp_path / "bag", unchanged, {JOURNAL})
    with pytest.raises(UnverifiableError, match="holds nothing that /rpud/journal could prove"):
        verify(tmp_path / "bag")


@pytest.mark.parametrize(
    ("number", "text"), [(0, "0 to 0 .* its recorder came too late"), (1, "1 to 1")]
)
def test_a_journal_with_a_gap_cannot_be_verified(bag, tmp_path, number, text):
    altered(bag, tmp_path / "bag", numbered("journal", number, lambda m: []))
    with pytest.raises(UnverifiableError, match=f"entries {text}"):
        verify(tmp_path / "bag")


@pytest.mark.parametrize(
    "edit",
    [
        lambda content: content.pop("time"),
        lambda content: content.pop("parameters"),
        lambda content: content["parameters"].update(telemetry_rate="fast"),
        lambda content: content["parameters"].update(block_duration=0.0),
        lambda content: content["faults"][0].update(kind="jam on toast"),
    ],
)
def test_a_journal_that_makes_no_sense_cannot_be_verified(bag, tmp_path, edit):
    altered(bag, tmp_path / "bag", edited(edit))
    with pytest.raises(UnverifiableError, match="journal"):
        verify(tmp_path / "bag")


def of_another_type(source, out, definition, fields):
    """Copy a bag with contact forces of another definition, with these fields alone."""
    name = "rpud_msgs/msg/ContactForce"
    installed, other = Codec(name, find_definition(name)), Codec(name, definition)
    topic = "/rpud/contact_force"
    with rpud_sim.bag.open(source) as reader, rpud_sim.bag.BagWriter(out) as writer:
        for summary in reader.topics:
            if summary.topic.name == topic:
                changed = dataclasses.replace(summary.topic, type_hash=other.type_hash)
                writer.add_topic(changed, definition)
            else:
                writer.add_topic(summary.topic, summary.definition)
        for message in reader.messages():
            data = message.data
            if message.topic == topic:
                decoded = installed.decode(data)
                values = {field: getattr(decoded, field) for field in fields}
                stamp = decoded.header.stamp
                values["header"] = {
                    "stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec},
                    "frame_id": decoded.header.frame_id,
                }
                data = other.encode(values)
            writer.write(message.topic, data, message.log_time, message.publish_time)
    return out


def without_lines(definition, *fields):
    """Give a definition without the lines of some fields."""
    return "\n".join(
        line for line in definition.splitlines() if line.split()[1:2] not in [[f] for f in fields]
    )


NUMBERS = ("sequence", "peak_force", "contact_duration", "impact_velocity", "impulse", "energy")


def test_messages_of_an_earlier_type_are_proved_as_far_as_they_go(bag, tmp_path):
    definition = find_definition("rpud_msgs/msg/ContactForce")
    earlier = without_lines(definition, "energy_transferred", "squeezed")
    verification = verify(of_another_type(bag, tmp_path / "bag", earlier, NUMBERS))
    assert verification.proved
    assert verification.topics["/rpud/contact_force"].equal > 80
    assert verification.warnings == (
        "/rpud/contact_force is of an earlier version, without energy_transferred, squeezed",
    )


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
            writer.write(message.topic, message.data, message.log_time, message.publish_time)
    with pytest.raises(UnverifiableError, match="/rpud/contact_force is of another version of"):
        verify(out)
