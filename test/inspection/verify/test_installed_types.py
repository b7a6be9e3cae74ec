"""Messages of another version of a type: proved as far as both versions agree, or refused."""

import dataclasses

import pytest

import rpud_sim.bag
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.inspection.verify.recorded_journal import UnverifiableError
from rpud_sim.inspection.verify.verification import verify


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
