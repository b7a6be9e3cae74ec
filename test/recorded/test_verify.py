"""What a bag proves, and what it does not: altered, shortened and torn apart."""

import dataclasses
import struct

import pytest
from altered_bags import altered, copied, edited, flipped, merged, messages_of, numbered
from forked_runs import JOURNAL, ON_ARM
from sample_bags import write_offline_bag

import rpud_sim.bag
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.definitions import find_definition
from rpud_sim.recorded.journal import UnverifiableError
from rpud_sim.recorded.streams import first_field
from rpud_sim.recorded.verify import PROVED, verify
from rpud_sim.simulation import preset
from rpud_sim.simulation.topics import TOPICS

SECOND = 1_000_000_000
DURATION = 0.33
# Field of each type, and where it lies from the end of the message, or from its beginning [bytes].
FIELDS = {
    "actuator_state": ("temperature", -8),
    "borehole": ("side_offset", -8),
    "contact_force": ("energy_transferred", -9),
    "drill_tool": ("in_contact", -16),
    "faults": ("forgotten", -8),
    "joint_states": ("effort[2]", -8),
    "mount": ("slip", -8),
    "nodal_plane": ("impacts", -8),
    "reacting_force": ("force", -16),
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
    held = [m for m in messages_of(bag) if m.topic.removeprefix("/rpud/") in PROVED]
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


_NANS = "000000000000f87f", "010000000000f87f"


def test_a_nan_with_other_bits_is_another_value():
    codec = Codec("std_msgs/msg/Float64", "float64 data")
    one, other = (codec.decode(bytes.fromhex(f"00010000{bits}")) for bits in _NANS)
    bits = "nan (bits 7ff8000000000000)", "nan (bits 7ff8000000000001)"
    assert first_field(one, other) == ("data", *bits)
    assert first_field(one, one) is None


def test_padding_between_fields_is_ignored(bag, tmp_path):
    codec = Codec("rpud_msgs/msg/ReactingForce", find_definition("rpud_msgs/msg/ReactingForce"))
    original = messages_of(bag, {"/rpud/reacting_force"})[3].data
    place = len(original) - 17  # the frame's name ends at an odd place, and a double does not
    assert first_field(codec.decode(flipped(original, place)), codec.decode(original)) is None
    change = numbered("reacting_force", 3, lambda m: [flipped(m.data, place)])
    assert verify(altered(bag, tmp_path / "bag", change)).proved


def test_messages_of_another_run_differ(bag, tmp_path):
    """They were published while the second run was on, and are of the first one."""
    second = tmp_path / "second"
    write_offline_bag(second, preset("drilling"), DURATION, 0.7, (), 12)

    def swapped(message):
        return [message.data] if message.topic != "/rpud/wrench" else []

    altered(second, tmp_path / "without", swapped)
    path = merged(tmp_path / "bag", (bag, 0, "/rpud"), (tmp_path / "without", 10 * SECOND, "/rpud"))
    assert verify(path).total.unexpected == 0
    with rpud_sim.bag.BagWriter(tmp_path / "mixed") as writer:
        copied(writer, path)
        copied(writer, bag, topics={"/rpud/wrench"}, shift=10 * SECOND, delay=1000)
    found = verify(tmp_path / "mixed")
    assert found.first_difference.topic == "/rpud/wrench"
    assert found.topics["/rpud/wrench"].different > 0


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
    held = [m for m in messages_of(tmp_path / "bag") if m.topic.removeprefix("/rpud/") in PROVED]
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


def redefined(bag, out, name, definition, change=bytes, *, hashed=True):
    """Copy a bag, with another definition and other messages of one topic."""
    with rpud_sim.bag.open(bag) as reader, rpud_sim.bag.BagWriter(out) as writer:
        for summary in reader.topics:
            topic, text = summary.topic, summary.definition
            if topic.name == f"/rpud/{name}":
                type_hash = Codec(topic.type, definition).type_hash if hashed else ""
                topic, text = dataclasses.replace(topic, type_hash=type_hash), definition
            writer.add_topic(topic, text)
        for message in reader.messages():
            data = change(message.data) if message.topic == f"/rpud/{name}" else message.data
            writer.write(message.topic, data, message.log_time, message.publish_time)
    return out


@pytest.mark.parametrize(
    ("old", "new"), [("float64 energy ", "float32 energy "), ("float64 energy ", "float64 power ")]
)
def test_a_type_with_a_field_of_its_own_cannot_be_proved(bag, tmp_path, old, new):
    definition = find_definition("rpud_msgs/msg/ContactForce").replace(old, new)
    out = redefined(bag, tmp_path / "bag", "contact_force", definition)
    with pytest.raises(UnverifiableError, match="/rpud/contact_force is of another version of"):
        verify(out)


@pytest.mark.parametrize("topic", ["nodal_plane", "drill_tool", "reacting_force"])
@pytest.mark.parametrize("hashed", [True, False], ids=["with a hash", "without a hash"])
def test_a_bag_of_before_the_number_of_impacts_cannot_be_proved(bag, tmp_path, topic, hashed):
    kind = TOPICS[topic].type
    lines = find_definition(kind).splitlines(keepends=True)
    definition = "".join(line for line in lines if not line.startswith("uint64 impacts"))
    out = redefined(bag, tmp_path / "bag", topic, definition, lambda data: data[:-8], hashed=hashed)
    with pytest.raises(UnverifiableError) as error:
        verify(out)
    assert str(error.value) == f"/rpud/{topic} is of another version of {kind}, without impacts"


@pytest.mark.parametrize("definition", [None, "", "float64 force\nfloat64 force"])
def test_a_type_without_hash_and_definition_is_taken_as_the_installed_one(
    bag, tmp_path, definition
):
    out = redefined(bag, tmp_path / "bag", "reacting_force", definition, hashed=False)
    if definition:
        with pytest.raises(UnverifiableError, match="has two fields of one name"):
            verify(out)
    else:
        assert verify(out).proved


# --- messages that a bag lacks ------------------------------------------------------------------


@pytest.fixture(scope="module")
def longer_bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("longer") / "bag"
    write_offline_bag(path, preset("drilling"), 4.0, 0.2, (), 11)
    return path


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
    impacts = messages_of(longer_bag, {"/rpud/contact_force"})
    topics = {JOURNAL, "/rpud/status", *(f"/rpud/{name}" for name in kept)}
    change = without("contact_force", after=2.0)
    verification = verify(altered(longer_bag, tmp_path / "bag", change, topics))
    assert not verification.proved
    assert (verification.first_difference, verification.undecided) == (None, "")
    counts = verification.topics["/rpud/contact_force"]
    assert (counts.tail, counts.missing) == (sum(m.log_time > 2e9 for m in impacts), 0)
    assert verification.total.tail == counts.tail


def test_a_topic_without_a_message_is_missing_too(longer_bag, tmp_path):
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


def test_a_topic_that_falls_silent_and_returns_is_missing_in_between(longer_bag, tmp_path):
    change = without("contact_force", after=1.0, before=3.0)
    verification = verify(altered(longer_bag, tmp_path / "bag", change))
    assert (verification.proved, verification.total.tail) == (False, 0)
    assert verification.topics["/rpud/contact_force"].missing > 700


# --- a drill that gets a command in each block, as from a controller of an arm -------------------


def test_a_stream_that_needs_a_pass_of_its_own_adds_no_simulated_time(longer_bag, monkeypatch):
    once = verify(longer_bag).simulated
    monkeypatch.setattr("rpud_sim.recorded.streams._MOST_WAITING", 0)
    assert verify(longer_bag).simulated == once


# --- what changes a proof, and what does not ----------------------------------------------------


@pytest.mark.parametrize(
    ("edit", "proved"),
    [
        (lambda content: content.update(made_by={"rpud_sim": "0.0.1", "numpy": "0.0.1"}), True),
        (lambda content: raised(content["parameters"], "load_spring_rate"), False),
    ],
    ids=["other libraries of the same engine", "another parameter"],
)
def test_the_engine_and_the_beginning_alone_decide(bag, tmp_path, edit, proved):
    change = edited(lambda fields, content: fields["kind"] == "begin" and edit(content))
    verification = verify(altered(bag, tmp_path / "bag", change))
    assert (verification.proved, verification.warnings) == (proved, ())


def raised(parameters, name):
    parameters[name] *= 1.0 + 2.0**-52


@pytest.mark.parametrize("change", [-1, 1, -100_000_000, SECOND])
def test_an_end_at_another_time_is_a_difference(bag, tmp_path, change):
    def edit(fields, content):
        content["time"] += change * (fields["kind"] == "end")

    found = verify(altered(bag, tmp_path / "altered", edited(edit)))
    assert found.first_difference is not None
    assert found.first_difference.topic == "/rpud/journal"
