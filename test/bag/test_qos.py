"""QoS profiles are written as rosbag2 does, and read from all its versions."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.metadata import INFINITE, QosProfile, dump_offered_qos, load_offered_qos

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


def test_policies_are_words_and_infinity_is_rmw_s():
    [profile] = yaml.safe_load(dump_offered_qos((QosProfile(),)))
    assert profile == {
        "history": "unknown",
        "depth": 0,
        "reliability": "reliable",
        "durability": "volatile",
        "deadline": {"sec": 9223372036, "nsec": 854775807},
        "lifespan": {"sec": 9223372036, "nsec": 854775807},
        "liveliness": "automatic",
        "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
        "avoid_ros_namespace_conventions": False,
    }


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
    assert load_offered_qos(text) == (
        QosProfile(
            history="unknown",
            depth=0,
            reliability="best_effort",
            durability="transient_local",
            deadline=INFINITE,
            lifespan=0,
            liveliness="automatic",
            liveliness_lease_duration=1_000_000_005,
            avoid_ros_namespace_conventions=True,
        ),
    )


@pytest.mark.parametrize("text", ["", "[]", "~"])
def test_no_offers(text):
    assert load_offered_qos(text) == ()


def test_a_policy_of_the_future_is_unknown():
    text = dump_offered_qos((QosProfile(),)).replace("volatile", "eternal")
    assert load_offered_qos(text)[0].durability == "unknown"


@pytest.mark.parametrize("text", ["reliable", "- {depth: 1}", "- 3", "{", "3"])
def test_what_is_no_list_of_profiles_is_refused(text):
    with pytest.raises(BagFormatError):
        load_offered_qos(text)
