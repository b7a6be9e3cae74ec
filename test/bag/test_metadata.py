"""Metadata and offers have every field that rosbag2 reads; earlier versions are read."""

import json

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from sample_bags import CHAT, START, TALK

from rpud_sim.bag import BagFormatError
from rpud_sim.bag.metadata import (
    INFINITE,
    FileInformation,
    Losses,
    QosProfile,
    ReadMetadata,
    dump_document,
    dump_offered_qos,
    load_offered_qos,
    losses_from_record,
    losses_to_record,
    metadata_from_document,
    metadata_of,
)
from rpud_sim.bag.own_records import Manifest, manifest_from_record

FILES = [FileInformation("bag_0.mcap", START, 3_000, 7)]
METADATA = metadata_of(FILES, {TALK: 4, CHAT: 3})


def test_every_field_of_version_9_is_there():
    document = yaml.safe_load(dump_document(METADATA))
    assert list(document) == ["rosbag2_bagfile_information"]
    content = document["rosbag2_bagfile_information"]
    times = {
        "starting_time": {"nanoseconds_since_epoch": START},
        "duration": {"nanoseconds": 3_000},
        "message_count": 7,
    }
    [(talk, _), _] = [each.values() for each in content.pop("topics_with_message_count")]
    assert content == {
        "version": 9,
        "storage_identifier": "mcap",
        **times,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": ["bag_0.mcap"],
        "files": [{"path": "bag_0.mcap", **times}],
        "custom_data": {},
        "ros_distro": "jazzy",
    }
    unlimited = {"sec": 9223372036, "nsec": 854775807}
    offer = {
        "history": "unknown",
        "depth": 0,
        "reliability": "reliable",
        "durability": "volatile",
        "deadline": unlimited,
        "lifespan": unlimited,
        "liveliness": "automatic",
        "liveliness_lease_duration": unlimited,
        "avoid_ros_namespace_conventions": False,
    }
    assert yaml.safe_load(dump_offered_qos(TALK.offered_qos)) == [offer]
    assert talk == {
        "name": TALK.name,
        "type": TALK.type,
        "serialization_format": "cdr",
        "offered_qos_profiles": [offer],
        "type_description_hash": TALK.type_hash,
    }


def test_round_trip():
    read = ReadMetadata("mcap", ("bag_0.mcap",), "", {"bag_0.mcap": 7})
    assert metadata_from_document(dump_document(METADATA)) == read
    same = dump_document(metadata_of(FILES, {TALK: 0, CHAT: 0}))
    assert not {"&", "*"} & {*same}  # no aliases


def test_version_4_of_galactic_is_read():
    document = """
rosbag2_bagfile_information:
  version: 4
  storage_identifier: mcap
  relative_file_paths: [talker.mcap]
  topics_with_message_count:
  - message_count: 10
    topic_metadata: {name: /topic, offered_qos_profiles: "- history: 3\\n  depth: 0"}
"""
    assert metadata_from_document(document) == ReadMetadata("mcap", ("talker.mcap",), "", {})


durations = st.one_of(st.just(INFINITE), st.integers(0, 10**18))
profiles = st.builds(
    QosProfile,
    history=st.sampled_from(["keep_last", "keep_all", "unknown"]),
    depth=st.integers(0, 10_000),
    reliability=st.sampled_from(["reliable", "best_effort", "best_available"]),
    durability=st.sampled_from(["volatile", "transient_local"]),
    deadline=durations,
    lifespan=durations,
    liveliness=st.sampled_from(["automatic", "manual_by_topic"]),
    liveliness_lease_duration=durations,
    avoid_ros_namespace_conventions=st.booleans(),
)


@given(st.lists(profiles, max_size=3).map(tuple))
def test_profiles_survive_the_round_trip(offered):
    assert load_offered_qos(dump_offered_qos(offered)) == offered


def test_numbers_of_versions_before_9_are_understood():
    text = """
- history: 3
  depth: 0
  reliability: 2
  durability: 1
  deadline: {sec: 2147483647, nsec: 4294967295}
  lifespan: {sec: 0, nsec: 0}
  liveliness: 1
  liveliness_lease_duration: {sec: 1, nsec: 5}
  avoid_ros_namespace_conventions: true
"""
    words = ("unknown", 0, "best_effort", "transient_local")
    times = (INFINITE, 0, "automatic", 1_000_000_005)
    assert load_offered_qos(text) == (QosProfile(*words, *times, True),)


def test_losses_survive_the_bag_and_earlier_ones_are_read():
    losses = {"/a": Losses(transport=3, queue=2), "/b": Losses(None, 1, damaged=4)}
    assert losses_from_record(losses_to_record(losses)) == losses
    assert losses_from_record({"/a": '{"transport": 3, "queue": 2}'}) == {"/a": losses["/a"]}
    assert (losses["/a"].total, losses["/b"].total) == (5, None)


VALUES = st.one_of(
    st.booleans(), st.integers(), st.floats(allow_nan=False), st.text(), st.lists(st.floats(0, 1))
)


@given(
    st.builds(
        Manifest,
        node=st.text(),
        time=st.integers(0, 2**63 - 1),
        parameters=st.dictionaries(st.text(), VALUES),
        scenario=st.none() | st.text(),
        command=st.lists(st.text()).map(tuple),
        versions=st.dictionaries(st.text(), st.text()),
        machine=st.text(),
    )
)
def test_a_manifest_comes_back_bit_for_bit(manifest):
    assert manifest_from_record(manifest.to_record()) == manifest


@pytest.mark.parametrize(
    "record",
    [
        {},
        {"manifest": ""},
        {"manifest": "[]"},
        {"manifest": "{}"},
        {"manifest": "[" * 100_000},
        {"manifest": json.dumps({**json.loads(Manifest().to_record()["manifest"]), "time": "x"})},
        {"manifest": json.dumps({**json.loads(Manifest().to_record()["manifest"]), "versions": 1})},
    ],
)
def test_what_is_no_manifest_is_one_clear_error(record):
    with pytest.raises(BagFormatError, match="the record rpud_manifest is unreadable"):
        manifest_from_record(record)


def test_texts_without_an_encoding_are_escaped(tmp_path):
    """File names may be other than UTF-8, and JSON may have halves of surrogate pairs."""
    manifest = Manifest(command=("rpud", "\udcff"), parameters={"scenario": "\ud800"})
    record = manifest.to_record()
    assert "".join(record.values()).encode("utf-8")
    found = manifest_from_record(record)
    assert found.command == ("rpud", "\\xff")
    assert found.parameters == {"scenario": "\\ud800"}
    text = json.dumps(json.loads(record["manifest"]) | {"node": "\udc80\ud800"})
    assert manifest_from_record({"manifest": text}).node.encode("utf-8")


def test_a_profile_that_lacks_policies_has_the_defaults():
    [found] = load_offered_qos("- {depth: 5, durability: 1, unknown: 3}")
    assert found == QosProfile(depth=5, durability="transient_local")
