"""Metadata has every field that rosbag2 reads; earlier versions are read."""

import pytest
import yaml
from sample_bags import CHAT, START, TALK

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.metadata import (
    BagMetadata,
    FileInformation,
    metadata_from_document,
    metadata_from_record,
)

METADATA = BagMetadata(
    start_time=START,
    duration=3_000,
    message_count=7,
    topics=((TALK, 4), (CHAT, 3)),
    files=(FileInformation("bag_0.mcap", START, 3_000, 7),),
    custom_data={"operator": "yes", "number": "1"},
    ros_distro="jazzy",
    relative_file_paths=("bag_0.mcap",),
)


def test_every_field_of_version_9_is_there():
    document = yaml.safe_load(METADATA.to_document())
    assert list(document) == ["rosbag2_bagfile_information"]
    content = document["rosbag2_bagfile_information"]
    assert content.keys() == {
        "version",
        "storage_identifier",
        "duration",
        "starting_time",
        "message_count",
        "topics_with_message_count",
        "compression_format",
        "compression_mode",
        "relative_file_paths",
        "files",
        "custom_data",
        "ros_distro",
    }
    assert content["version"] == 9
    assert content["duration"] == {"nanoseconds": 3_000}
    assert content["starting_time"] == {"nanoseconds_since_epoch": START}
    assert content["files"] == [
        {
            "path": "bag_0.mcap",
            "starting_time": {"nanoseconds_since_epoch": START},
            "duration": {"nanoseconds": 3_000},
            "message_count": 7,
        }
    ]
    topic = content["topics_with_message_count"][0]
    assert topic.keys() == {"topic_metadata", "message_count"}
    assert topic["topic_metadata"].keys() == {
        "name",
        "type",
        "serialization_format",
        "offered_qos_profiles",
        "type_description_hash",
    }
    assert isinstance(topic["topic_metadata"]["offered_qos_profiles"], list)


def test_the_text_has_no_yaml_aliases():
    same = BagMetadata(START, 0, 0, ((TALK, 0), (TALK, 0)), METADATA.files)
    assert "&" not in same.to_document()
    assert "*" not in same.to_document()


def test_round_trip():
    assert metadata_from_document(METADATA.to_document()) == METADATA
    assert metadata_from_record(METADATA.to_record()) == METADATA


def test_version_4_of_galactic_is_read():
    document = """
rosbag2_bagfile_information:
  compression_format: ''
  compression_mode: ''
  duration:
    nanoseconds: 5
  message_count: 10
  relative_file_paths:
  - talker.mcap
  starting_time:
    nanoseconds_since_epoch: 1585866235112411371
  storage_identifier: mcap
  topics_with_message_count:
  - message_count: 10
    topic_metadata:
      name: /topic
      offered_qos_profiles: "- history: 3\\n  depth: 0\\n  reliability: 1\\n  durability: 2\\n\\
        \\  deadline: {sec: 0, nsec: 0}\\n  lifespan: {sec: 0, nsec: 0}\\n  liveliness: 1\\n\\
        \\  liveliness_lease_duration: {sec: 0, nsec: 0}\\n\\
        \\  avoid_ros_namespace_conventions: false"
      serialization_format: cdr
      type: std_msgs/msg/String
  version: 4
"""
    metadata = metadata_from_document(document)
    assert metadata.version == 4
    assert metadata.relative_file_paths == ("talker.mcap",)
    [(topic, count)] = metadata.topics
    assert (topic.name, count) == ("/topic", 10)
    assert [qos.reliability for qos in topic.offered_qos] == ["reliable"]


def test_empty_custom_data_may_be_null():
    document = METADATA.to_document().replace("  custom_data:\n", "  custom_data: ~\n")
    document = "\n".join(
        line for line in document.splitlines() if "operator" not in line and "number:" not in line
    )
    assert metadata_from_document(document).custom_data == {}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a: 1",
        "[",
        "\x00",
        "rosbag2_bagfile_information: 3",
        "rosbag2_bagfile_information: {version: 9}",
        METADATA.to_document().replace("message_count: 7", "message_count: many"),
    ],
)
def test_what_is_no_metadata_is_refused_in_one_line(text):
    with pytest.raises(BagFormatError) as caught:
        metadata_from_document(text)
    assert len(str(caught.value).splitlines()) == 1
