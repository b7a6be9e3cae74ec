"""Messages of another version of a type are refused where the versions disagree."""

import dataclasses

import pytest

import rpud_sim.bag
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.inspection.recorded_journal import UnverifiableError
from rpud_sim.inspection.verify.verification import verify


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
